// Shared by the store's tests: poses that encode a number, and writes in one line.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>

#include "tfdb/store/buffer.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb::fixture {

inline constexpr StampNs kSecond = clock::kNanosPerSecond;

/// A pose unique to `number`, never near the identity. `number_of` inverts it.
inline Pose pose_of(double number) {
    const double half = 0.2 + 0.003 * std::fmod(number, 100.0);
    return {{number, 0.5 - 2.0 * number, 0.25 * number},
            {0.6 * std::sin(half), 0.0, 0.8 * std::sin(half), std::cos(half)}};
}
inline double number_of(const Pose& pose) {
    return pose.translation.x;
}

/// The engine of the whole test program: TFDB_CONCURRENCY, or the default one.
inline Concurrency engine() {
    const char* const wish = std::getenv("TFDB_CONCURRENCY");
    return wish == nullptr ? Concurrency::kSnapshot : concurrency_of(wish);
}
inline BufferOptions defaults() {
    BufferOptions options;
    options.concurrency = engine();
    return options;
}

/// True in engines that do not promise what the test checks; the test then returns.
inline bool skipped_in(std::initializer_list<Concurrency> engines, const char* reason) {
    const bool skipped = std::find(engines.begin(), engines.end(), engine()) != engines.end();
    if (skipped) {
        std::printf("  skipped in %s: %s\n", std::string(concurrency_name(engine())).c_str(),
                    reason);
        testing::count_check();
    }
    return skipped;
}

inline BufferOptions keeping(std::optional<StampNs> history) {
    BufferOptions options = defaults();
    options.history_ns = history;
    return options;
}

inline CommitNumber set(Buffer& buffer, std::string_view parent, std::string_view child,
                        StampNs stamp, const Pose& pose, std::string_view authority = "") {
    return buffer.set_transform({parent, child, stamp, pose}, false, authority);
}
inline CommitNumber set_static(Buffer& buffer, std::string_view parent, std::string_view child,
                               const Pose& pose) {
    return buffer.set_transform({parent, child, 0, pose}, true, "");
}

inline bool identical(const Pose& a, const Pose& b) {
    return std::memcmp(&a, &b, sizeof a) == 0;
}

/// Greatest difference of two components; q and -q are equal.
inline double apart(const Pose& a, const Pose& b) {
    const double* left = &a.translation.x;
    const double* right = &b.translation.x;
    double dot = 0.0;
    for (int i = 3; i < 7; ++i)
        dot += left[i] * right[i];
    const double sign = dot < 0.0 ? -1.0 : 1.0;
    double most = 0.0;
    for (int i = 0; i < 7; ++i)
        most = std::fmax(most, std::fabs(left[i] - (i < 3 ? 1.0 : sign) * right[i]));
    return most;
}

/// The exception that `body` throws, which must be an E; a check fails otherwise, and the result is
/// empty.
template <class E, class Body>
std::optional<E> thrown(Body&& body, const char* file, int line) {
    testing::count_check();
    try {
        body();
    } catch (const E& error) {
        return error;
    } catch (const std::exception& other) {
        testing::report_failure(file, line, std::string("threw another type: ") + other.what());
        return std::nullopt;
    }
    testing::report_failure(file, line, "did not throw");
    return std::nullopt;
}

inline bool says(const Error& error, std::string_view phrase) {
    const bool found = std::string_view(error.what()).find(phrase) != std::string_view::npos;
    if (!found) {
        testing::report_failure(__FILE__, __LINE__,
                                "'" + std::string(phrase) + "' is not in: " + error.what());
    }
    return found;
}

}  // namespace tfdb::fixture

#define THROWN(Type, ...) \
    ::tfdb::fixture::thrown<Type>([&] { static_cast<void>(__VA_ARGS__); }, __FILE__, __LINE__)
