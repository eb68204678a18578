/* What memory alone costs: read once, or read and write past the cache, spread over threads; and what so many
   instructions cost, whatever they do. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#ifdef __SSE2__
#include <emmintrin.h>
#endif

enum { PART = 1 << 18 }; /* bytes a thread takes at a time */

uint64_t floor_read(const uint8_t *from, size_t bytes) {
    uint64_t total = 0;
#pragma omp parallel for schedule(dynamic) reduction(+ : total)
    for (size_t at = 0; at < bytes; at += PART) {
        const size_t end = bytes - at < PART ? bytes : at + PART;
        uint64_t sum = 0;
        for (size_t i = at; i + 8 <= end; i += 8) {
            uint64_t word;
            memcpy(&word, from + i, 8);
            sum += word;
        }
        total += sum;
    }
    return total;
}

/* `to` is aligned to 64 bytes, `bytes` a multiple of 64. */
void floor_copy(uint8_t *to, const uint8_t *from, size_t bytes) {
#pragma omp parallel for schedule(dynamic)
    for (size_t at = 0; at < bytes; at += PART) {
        const size_t end = bytes - at < PART ? bytes : at + PART;
#ifdef __SSE2__
        for (size_t i = at; i < end; i += 16)
            _mm_stream_si128((__m128i *)(to + i), _mm_loadu_si128((const __m128i *)(from + i)));
        _mm_sfence();
#else
        memcpy(to + at, from + at, end - at);
#endif
    }
}

/* `count` instructions that do not wait for each other, all in registers, in the mix that processors with AVX2
   take fastest: of 24, eight multiplications with additions and six additions of vectors, the rest scalar. In
   assembler, as compilers move registers to memory here. Returns 0 where there is no AVX2. */
int floor_instructions(size_t count) {
#ifdef __AVX2__
    enum { TASKS = 64, STEP = 24 };
#define VECTORS(a, b, c) "vfmadd213ps %%ymm15, %%ymm15, %%ymm" a "\n vpaddd %%ymm15, %%ymm15, %%ymm" b "\n add $1, %%" c "\n"
#define FMA(a, c) "vfmadd213ps %%ymm15, %%ymm15, %%ymm" a "\n add $1, %%" c "\n"
#pragma omp parallel for schedule(dynamic)
    for (int task = 0; task < TASKS; task++) {
        size_t left = count / (TASKS * STEP) + 1;
        __asm__ volatile("vxorps %%ymm15, %%ymm15, %%ymm15\n"
                         "1:\n" VECTORS("0", "8", "r8") VECTORS("1", "9", "r9") VECTORS("2", "10", "r10")
                         VECTORS("3", "11", "r11") VECTORS("4", "12", "rsi") VECTORS("5", "13", "rdi")
                         FMA("6", "rdx") FMA("7", "rcx") "sub $1, %0\n jnz 1b\n"
                         : "+r"(left)
                         :
                         : "cc", "rcx", "rdx", "rsi", "rdi", "r8", "r9", "r10", "r11", "xmm0", "xmm1", "xmm2", "xmm3",
                           "xmm4", "xmm5", "xmm6", "xmm7", "xmm8", "xmm9", "xmm10", "xmm11", "xmm12", "xmm13", "xmm15");
    }
    return 1;
#else
    (void)count;
    return 0;
#endif
}
