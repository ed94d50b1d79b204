#include "tfdb/store/clock.hpp"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <limits>
#include <mutex>

#include "tfdb/base/error.hpp"
#include "tfdb/base/interruption.hpp"
#include "tfdb/store/store.hpp"
#include "tfdb/store/waits.hpp"
#include "tfdb/sync/event_count.hpp"

namespace tfdb {
namespace {

constexpr std::int64_t kForEver = std::numeric_limits<std::int64_t>::max();
// A process may be killed between its setting and the wake-up of the sleepers.
constexpr std::int64_t kLongestSleepNs = 100'000'000;

StampNs system_now() {
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
}

StampNs as_stamp(double time) {
    return static_cast<StampNs>(std::clamp(time, 0.0, static_cast<double>(clock::kMaxStamp)));
}

StampNs time_of(const ClockSetting& set, std::int64_t now) {
    if (set.paused)
        return set.time;
    const std::int64_t passed = std::max<std::int64_t>(clock::saturating_sub(now, set.since), 0);
    // A double would lose nanoseconds.
    const StampNs moved =
        set.speed == 1.0 ? passed : as_stamp(set.speed * static_cast<double>(passed));
    return std::min(clock::saturating_add(set.time, moved), clock::kMaxStamp);
}

/// Real nanoseconds until the clock shows a stamp.
std::int64_t left_until(StampNs stamp, const std::optional<ClockSetting>& set) {
    if (!set)
        return clock::saturating_sub(stamp, system_now());
    const StampNs ahead = stamp - time_of(*set, sync::steady_now());
    if (ahead <= 0)
        return 0;
    if (set->paused)
        return kForEver;
    const double left = std::ceil(static_cast<double>(ahead) / set->speed);
    return left < static_cast<double>(kForEver) ? std::max<std::int64_t>(1, std::int64_t(left))
                                                : kForEver;
}

/// None: the store uses the system's clock.
std::optional<ClockSetting> setting_of(const store::Store& store) {
    const auto words = store::Store::ClockWords(store.clock_words).read();
    if (!words)
        return std::nullopt;
    const auto [time, since, speed, how] = *words;
    const ClockSetting found{
        .time = static_cast<StampNs>(time),
        .since = static_cast<std::int64_t>(since),
        .speed = std::bit_cast<double>(speed),
        .paused = how == store::Store::kPausedClock,
    };
    // Damaged words count as no setting.
    const bool is_set = (how == store::Store::kRunningClock || found.paused) &&
                        clock::is_stamp(found.time) && std::isfinite(found.speed) &&
                        found.speed > 0;
    return is_set ? std::optional(found) : std::nullopt;
}

}  // namespace

StampNs store::now(const Store& store) {
    const std::optional<ClockSetting> set = setting_of(store);
    return set ? time_of(*set, sync::steady_now()) : system_now();
}

std::optional<ClockSetting> Clock::setting() const {
    return setting_of(*store_);
}

StampNs Clock::now() const {
    return store::now(*store_);
}

std::uint64_t Clock::settings() const {
    return store::Store::ClockWords(store_->clock_words).writes();
}

bool Clock::sleep_until(StampNs stamp, std::optional<std::int64_t> timeout_ns,
                        std::optional<std::uint64_t> settings) const {
    const store::Deadline deadline(timeout_ns);
    sync::EventCount event(store_->clock_event);
    for (;;) {
        const std::uint64_t armed = event.arm();
        if (store_->waits_ended.load_acquire() != 0)
            store::raise_ended_wait(*store_, WaitEnd::kClosed);
        if (settings && this->settings() != *settings)
            return false;
        const std::int64_t left = left_until(stamp, setting());
        if (left <= 0)
            return true;
        if (store_->removed())
            store::raise_ended_wait(*store_, WaitEnd::kRemoved);
        const std::int64_t longest = std::min(deadline.left(), kLongestSleepNs);
        if (longest <= 0)
            return false;
        (void)event.sleep(armed, std::min(left, longest));
        interruption_point();
    }
}

/// Passes the current setting to `change`, and stores the result.
template <class Change>
void Clock::change(Change change) const {
    using Words = store::Store::ClockWords;
    store::check_may_wait(*store_);
    {
        const std::lock_guard<store::WriterLock> guard(store_->lock);
        const NotInterrupted not_interrupted;
        const std::int64_t now = sync::steady_now();
        const std::optional<ClockSetting> before = setting();
        ClockSetting set = before.value_or(ClockSetting{});
        set.time = before ? time_of(*before, now) : system_now();
        set.since = now;
        const bool follows = !change(set);
        Words(store_->clock_words)
            .write({static_cast<std::uint64_t>(set.time), static_cast<std::uint64_t>(set.since),
                    std::bit_cast<std::uint64_t>(set.speed),
                    follows      ? store::Store::kSystemClock
                    : set.paused ? store::Store::kPausedClock
                                 : store::Store::kRunningClock});
    }
    sync::EventCount(store_->clock_event).notify();
}

void Clock::seek(StampNs time) const {
    if (!clock::is_stamp(time))
        throw InvalidStamp("a clock cannot show " + std::to_string(time) +
                           ": stamps are from 0 to " + std::to_string(clock::kMaxStamp) + " ns");
    change([time](ClockSetting& set) {
        set.time = time;
        return true;
    });
}

void Clock::pause() const {
    change([](ClockSetting& set) { return set.paused = true; });
}

void Clock::resume() const {
    change([](ClockSetting& set) {
        set.paused = false;
        return true;
    });
}

void Clock::set_speed(double speed) const {
    if (!std::isfinite(speed) || speed <= 0)
        throw InvalidArgument("the speed of a clock must be positive and finite, got " +
                              std::to_string(speed));
    change([speed](ClockSetting& set) {
        set.speed = speed;
        return true;
    });
}

Clock Buffer::clock() const {
    return Clock(store_);
}

void Clock::follow_system() const {
    change([](ClockSetting&) { return false; });
}

}  // namespace tfdb
