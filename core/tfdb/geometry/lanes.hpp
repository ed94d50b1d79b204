// A few doubles side by side, by the vector extensions of GCC and Clang: two on every machine, four
// with AVX2, eight with AVX-512. Only the kernel files include this. The width is part of every
// type and every function is always inlined, so the linker cannot substitute a function that
// another file compiled for another instruction set.
#pragma once

#include <cstddef>
#include <cstdint>

#ifdef __AVX2__
#include <immintrin.h>
#endif

#include "tfdb/geometry/pose.hpp"

namespace tfdb::geometry {

template <class Vector>
TFDB_INLINE Vector load(const void* from) {
    Vector value;
    __builtin_memcpy(&value, from, sizeof value);
    return value;
}

template <class Vector>
TFDB_INLINE void store(void* to, Vector value) {
    __builtin_memcpy(to, &value, sizeof value);
}

/// Rows of eight doubles, one for each lane.
using Rows = const void* const*;

TFDB_INLINE const char* part(Rows rows, int lane, int from) {
    return static_cast<const char*>(rows[lane]) + sizeof(double) * static_cast<unsigned>(from);
}

template <int Count>
struct Lanes;

/// Two lanes: SSE2, NEON, or the compiler's substitute.
template <>
struct Lanes<2> {
    using Real = double __attribute__((vector_size(16)));
    using Word = std::uint64_t __attribute__((vector_size(16)));
    using Mask = decltype(Real{} < Real{});

    TFDB_INLINE static Real fill(double value) { return Real{value, value}; }
    TFDB_INLINE static Word fill(std::uint64_t value) { return Word{value, value}; }
    template <class Each>
    TFDB_INLINE static Real make(Each each) {
        return Real{each(0), each(1)};
    }
    TFDB_INLINE static bool any(Mask mask) { return (mask[0] | mask[1]) != 0; }
    TFDB_INLINE static Real choose(Mask mask, Real yes, Real no) {
        return reinterpret_cast<Real>((mask & reinterpret_cast<Mask>(yes)) |
                                      (~mask & reinterpret_cast<Mask>(no)));
    }
    TFDB_INLINE static Real root(Real a) {
        return Real{__builtin_sqrt(a[0]), __builtin_sqrt(a[1])};
    }

    /// Two doubles of each row become two columns.
    TFDB_INLINE static void transpose(Real& r0, Real& r1) {
        const Real c0{r0[0], r1[0]};
        const Real c1{r0[1], r1[1]};
        r0 = c0;
        r1 = c1;
    }
    /// Rows become columns.
    TFDB_INLINE static void columns(Rows rows, Real* out) {
        for (int i = 0; i < 8; i += 2) {
            out[i] = load<Real>(part(rows, 0, i));
            out[i + 1] = load<Real>(part(rows, 1, i));
            transpose(out[i], out[i + 1]);
        }
    }

    /// The positions of the lanes' numbers, in columns that begin with the first lane's.
    using Places = std::uint32_t;
    TFDB_INLINE static Places places(const std::uint32_t* of) { return of[1] - of[0]; }
    TFDB_INLINE static Real spread(const void* column, Places places) {
        const auto* const bytes = static_cast<const char*>(column);
        return Real{load<double>(bytes), load<double>(bytes + sizeof(double) * places)};
    }
};

template <>
struct Arithmetic<Lanes<2>::Real> : Lanes<2> {};

#ifdef __AVX2__
template <>
struct Lanes<4> {
    using Real = double __attribute__((vector_size(32)));
    using Word = std::uint64_t __attribute__((vector_size(32)));
    using Mask = decltype(Real{} < Real{});

    TFDB_INLINE static Real fill(double value) { return Real{value, value, value, value}; }
    TFDB_INLINE static Word fill(std::uint64_t value) { return Word{value, value, value, value}; }
    // From an initializer list: lane-by-lane assignment makes GCC go through memory.
    template <class Each>
    TFDB_INLINE static Real make(Each each) {
        return Real{each(0), each(1), each(2), each(3)};
    }
    TFDB_INLINE static bool any(Mask mask) {
        return _mm256_movemask_pd(reinterpret_cast<__m256d>(mask)) != 0;
    }
    TFDB_INLINE static Real choose(Mask mask, Real yes, Real no) {
        return _mm256_blendv_pd(no, yes, reinterpret_cast<__m256d>(mask));
    }
    TFDB_INLINE static Real root(Real a) { return _mm256_sqrt_pd(a); }

    /// Four doubles of each row become four columns.
    TFDB_INLINE static void transpose(Real& r0, Real& r1, Real& r2, Real& r3) {
        const __m256d a = _mm256_unpacklo_pd(r0, r1);
        const __m256d b = _mm256_unpackhi_pd(r0, r1);
        const __m256d c = _mm256_unpacklo_pd(r2, r3);
        const __m256d d = _mm256_unpackhi_pd(r2, r3);
        r0 = _mm256_permute2f128_pd(a, c, 0x20);
        r1 = _mm256_permute2f128_pd(b, d, 0x20);
        r2 = _mm256_permute2f128_pd(a, c, 0x31);
        r3 = _mm256_permute2f128_pd(b, d, 0x31);
    }
    TFDB_INLINE static void columns(Rows rows, Real* out) {
        for (int i = 0; i < 8; i += 4) {
            for (int lane = 0; lane < 4; ++lane)
                out[i + lane] = load<Real>(part(rows, lane, i));
            transpose(out[i], out[i + 1], out[i + 2], out[i + 3]);
        }
    }

    using Places = __m256i;
    TFDB_INLINE static Places places(const std::uint32_t* of) {
        const __m128i from_first =
            _mm_sub_epi32(load<__m128i>(of), _mm_set1_epi32(static_cast<int>(of[0])));
        // Each double counts as two numbers of 32 bits.
        const __m256i low = _mm256_slli_epi64(_mm256_cvtepu32_epi64(from_first), 1);
        const __m256i high = _mm256_slli_epi64(_mm256_add_epi64(low, _mm256_set1_epi64x(1)), 32);
        return _mm256_or_si256(low, high);
    }
    TFDB_INLINE static Real spread(const void* column, Places places) {
        return reinterpret_cast<Real>(_mm256_permutevar8x32_epi32(load<__m256i>(column), places));
    }
};

template <>
struct Arithmetic<Lanes<4>::Real> : Lanes<4> {};
#endif

#ifdef __AVX512DQ__
template <>
struct Lanes<8> {
    using Real = double __attribute__((vector_size(64)));
    using Word = std::uint64_t __attribute__((vector_size(64)));
    using Mask = decltype(Real{} < Real{});

    TFDB_INLINE static Real fill(double value) {
        return Real{value, value, value, value, value, value, value, value};
    }
    TFDB_INLINE static Word fill(std::uint64_t value) {
        return Word{value, value, value, value, value, value, value, value};
    }
    TFDB_INLINE static __mmask8 bits(Mask mask) {
        return _mm512_movepi64_mask(reinterpret_cast<__m512i>(mask));
    }
    TFDB_INLINE static bool any(Mask mask) { return bits(mask) != 0; }
    TFDB_INLINE static Real choose(Mask mask, Real yes, Real no) {
        return _mm512_mask_blend_pd(bits(mask), no, yes);
    }
    TFDB_INLINE static Real root(Real a) { return _mm512_maskz_sqrt_pd(kAll, a); }

    TFDB_INLINE static void columns(Rows rows, Real* out) {
        Real pairs[8];
        for (int i = 0; i < 8; i += 2) {
            const auto a = load<Real>(rows[i]);
            const auto b = load<Real>(rows[i + 1]);
            pairs[i] = __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14);
            pairs[i + 1] = __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15);
        }
        for (int i = 0; i < 2; ++i) {
            const Real a = even_quarters(pairs[i], pairs[i + 2]);
            const Real b = even_quarters(pairs[i + 4], pairs[i + 6]);
            const Real c = odd_quarters(pairs[i], pairs[i + 2]);
            const Real d = odd_quarters(pairs[i + 4], pairs[i + 6]);
            out[i] = even_quarters(a, b);
            out[i + 2] = even_quarters(c, d);
            out[i + 4] = odd_quarters(a, b);
            out[i + 6] = odd_quarters(c, d);
        }
    }

    using Places = __m512i;
    TFDB_INLINE static Places places(const std::uint32_t* of) {
        const __m256i first = _mm256_set1_epi32(static_cast<int>(of[0]));
        return _mm512_maskz_cvtepu32_epi64(kAll, _mm256_sub_epi32(load<__m256i>(of), first));
    }
    TFDB_INLINE static Real spread(const void* column, Places places) {
        return _mm512_maskz_permutexvar_pd(kAll, places, load<__m512d>(column));
    }

private:
    // GCC warns about the uninitialised source of the forms without a mask
    static constexpr __mmask8 kAll = 0xFF;

    TFDB_INLINE static Real even_quarters(Real a, Real b) {
        return __builtin_shufflevector(a, b, 0, 1, 4, 5, 8, 9, 12, 13);
    }
    TFDB_INLINE static Real odd_quarters(Real a, Real b) {
        return __builtin_shufflevector(a, b, 2, 3, 6, 7, 10, 11, 14, 15);
    }
};

template <>
struct Arithmetic<Lanes<8>::Real> : Lanes<8> {};
#endif

}  // namespace tfdb::geometry
