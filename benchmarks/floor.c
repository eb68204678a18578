/* What memory alone costs: read once, or read and write past the cache, spread over threads. */
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
