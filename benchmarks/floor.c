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

/* `count` instructions that do not wait for each other: as many vector multiplications with additions as
   additions of integers, and one branch in 17. */
float floor_instructions(size_t count) {
    typedef float vf __attribute__((vector_size(32)));
    typedef int32_t vi __attribute__((vector_size(32)));
    enum { TASKS = 64, STEP = 17 };
    float total = 0;
#pragma omp parallel for schedule(dynamic) reduction(+ : total)
    for (int task = 0; task < TASKS; task++) {
        vf a[8] = {0};
        vi n[8] = {0};
        for (size_t i = 0; i < count / (TASKS * STEP); i++)
            for (int k = 0; k < 8; k++) {
                a[k] = a[k] * 0.5f + 1.0f, n[k] += 1;
                __asm__ volatile("" : "+x"(a[k]), "+x"(n[k]));
            }
        for (int k = 0; k < 8; k++) total += a[k][0] + (float)n[k][0];
    }
    return total;
}
