// The clock of a store: its time, its visibility in other processes, and sleeps on it.
#include "tfdb/store/clock.hpp"

#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <thread>

#include "tfdb/base/error.hpp"
#include "tfdb/store/buffer.hpp"
#include "tfdb/store/fixture.hpp"
#include "tfdb/sync/word.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb {
namespace {

constexpr StampNs kSecond = clock::kNanosPerSecond;
constexpr StampNs kThen = 1'000 * kSecond;

StampNs system_time() {
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

/// Returns when `act` has ended a thread's sleep. It uses no timeout: otherwise the test hangs.
template <class Act>
bool sleeps_until(const Clock& clock, StampNs stamp, Act act) {
    std::optional<bool> came;
    std::thread sleeper([&] { came = clock.sleep_until(stamp, std::nullopt); });
    act();
    sleeper.join();
    return came.value_or(false);
}

}  // namespace

TFDB_TEST(clock_shows_the_time_of_the_system_until_it_is_set) {
    const Buffer buffer;
    const Clock clock = buffer.clock();
    CHECK(!clock.setting());
    const StampNs before = system_time();
    const StampNs shown = clock.now();
    CHECK(before <= shown && shown <= system_time());

    clock.seek(kThen);
    CHECK(clock.now() >= kThen);
    clock.follow_system();
    CHECK(!clock.setting());
    CHECK(clock.now() >= before);
}

TFDB_TEST(clock_keeps_its_time_while_paused_and_its_speed) {
    const Buffer buffer;
    const Clock clock = buffer.clock();
    clock.seek(kThen);
    clock.pause();
    const StampNs shown = clock.now();
    CHECK(shown >= kThen);
    CHECK_EQ(clock.now(), shown);
    clock.set_speed(4.0);
    CHECK_EQ(clock.now(), shown);
    clock.seek(kThen + 7);
    CHECK_EQ(clock.now(), kThen + 7);
    clock.pause();
    CHECK_EQ(clock.now(), kThen + 7);
    clock.resume();
    CHECK_EQ(clock.setting()->speed, 4.0);
    CHECK(!clock.setting()->paused);

    const std::int64_t real = sync::steady_now();
    const StampNs first = clock.now();
    while (sync::steady_now() < real + 1'000'000) {
    }
    const StampNs passed = clock.now() - first;
    CHECK(passed >= 3'900'000);
    CHECK(passed <= 4 * (sync::steady_now() - real) + 4);
}

TFDB_TEST(clock_never_leaves_the_range_of_stamps) {
    const Buffer buffer;
    const Clock clock = buffer.clock();
    clock.seek(clock::kMaxStamp);
    CHECK_EQ(clock.now(), clock::kMaxStamp);
    clock.set_speed(1e300);
    CHECK_EQ(clock.now(), clock::kMaxStamp);
    clock.seek(0);
    CHECK(clock.now() <= clock::kMaxStamp);
    for (const StampNs bad : {StampNs{-1}, clock::kMaxStamp + 1})
        CHECK(THROWN(InvalidStamp, clock.seek(bad)));
    for (const double bad : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()})
        CHECK(THROWN(InvalidArgument, clock.set_speed(bad)));
    CHECK_EQ(clock.setting()->speed, 1e300);
}

TFDB_TEST(clock_wakes_sleeps_at_every_setting) {
    const Buffer buffer;
    const Clock clock = buffer.clock();
    clock.pause();
    clock.seek(kThen);
    CHECK(clock.sleep_until(kThen, 0));
    CHECK(!clock.sleep_until(kThen + 1, 0));
    CHECK(!clock.sleep_until(kThen + 1, 1'000'000));
    CHECK(sleeps_until(clock, kThen + kSecond, [&] { clock.seek(kThen + kSecond); }));
    CHECK(sleeps_until(clock, kThen + 3'600 * kSecond, [&] {
        clock.resume();
        clock.set_speed(1e12);
    }));
    clock.seek(0);
    clock.set_speed(1.0);
    CHECK(sleeps_until(clock, kThen, [&] { clock.follow_system(); }));
}

TFDB_TEST(clock_sleeps_end_with_the_buffer) {
    const Buffer buffer;
    const Clock clock = buffer.clock();
    clock.seek(0);
    clock.pause();
    std::optional<ErrorCode> error;
    std::thread sleeper([&] {
        try {
            (void)clock.sleep_until(kThen, std::nullopt);
        } catch (const Error& thrown) {
            error = thrown.code();
        }
    });
    buffer.end_waits();
    sleeper.join();
    CHECK(error == ErrorCode::kBufferClosed);
}

}  // namespace tfdb
