// A few doubles side by side, by the vector extensions of GCC and Clang: two on every machine, four
// with AVX2. Only the kernel files include this; the width is part of every type, so no inline
// function compiled for AVX2 can be taken for the one of another file by the linker.
#pragma once

#include <cstddef>
#include <cstdint>

#ifdef __AVX2__
#include <immintrin.h>
#endif

#include "tfdb/geometry/pose.hpp"

namespace tfdb::geometry {

template <int Count>
struct Lanes;

/// Two lanes: SSE2, NEON, or whatever the compiler makes of them.
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
    template <class Each>
    TFDB_INLINE static Word make_words(Each each) {
        return Word{each(0), each(1)};
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
    // From a list: assigning lane by lane makes GCC go through memory.
    template <class Each>
    TFDB_INLINE static Real make(Each each) {
        return Real{each(0), each(1), each(2), each(3)};
    }
    template <class Each>
    TFDB_INLINE static Word make_words(Each each) {
        return Word{each(0), each(1), each(2), each(3)};
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
};

template <>
struct Arithmetic<Lanes<4>::Real> : Lanes<4> {};
#endif

}  // namespace tfdb::geometry
