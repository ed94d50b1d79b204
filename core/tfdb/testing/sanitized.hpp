// Whether a sanitizer watches this program, and how many rounds a test then runs.
#pragma once

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define TFDB_SANITIZED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define TFDB_SANITIZED 1
#endif
#endif
#ifndef TFDB_SANITIZED
#define TFDB_SANITIZED 0
#endif

namespace tfdb::testing {

inline constexpr bool kSanitized = TFDB_SANITIZED == 1;

/// An eighth of the rounds under a sanitizer: a round takes about ten times as long there, and
/// others count the rounds of the same test without one.
template <class Number>
constexpr Number rounds(Number all) {
    return kSanitized ? static_cast<Number>(all / 8) : all;
}

}  // namespace tfdb::testing
