// The clock of a store: the system's, until it is set.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "tfdb/base/types.hpp"
#include "tfdb/clock/stamp.hpp"

namespace tfdb {

using clock::StampNs;

namespace store {
struct Store;

/// The time of a store's clock.
[[nodiscard]] StampNs now(const Store& store);
}  // namespace store

/// The last setting of a clock.
struct ClockSetting {
    StampNs time = 0;        // the time that it showed
    std::int64_t since = 0;  // at this time of `sync::steady_now`
    double speed = 1.0;      // above 0, finite
    bool paused = false;
};

/// The time of all processes that have a store open. The setting lies in the store's control file.
/// A process that may not write there, or has a frozen store, sees the system's clock.
/// Threads: any. Guarantee: `now` is wait-free except for concurrent settings; `sleep_until`
/// blocks, and settings block as a commit does.
class Clock {
public:
    explicit Clock(std::shared_ptr<store::Store> store) : store_(std::move(store)) {}

    [[nodiscard]] StampNs now() const;
    /// None: it follows the system's clock.
    [[nodiscard]] std::optional<ClockSetting> setting() const;

    /// The number of settings so far.
    [[nodiscard]] std::uint64_t settings() const;

    /// Sleeps until the clock shows the stamp or a later one. False: it did not within the timeout,
    /// real nanoseconds (none: unlimited), or the clock was set more than `settings` times. Throws
    /// BufferClosed (`Buffer::end_waits`), NoSuchStore (the store was removed), and the
    /// exceptions of an Interruption.
    [[nodiscard]] bool sleep_until(StampNs stamp, std::optional<std::int64_t> timeout_ns,
                                   std::optional<std::uint64_t> settings = std::nullopt) const;

    /// All of these wake the sleepers. They throw ReadOnly, LockTimeout, CorruptStore,
    /// TransactionActive, InvalidArgument.
    void seek(StampNs time) const;
    void pause() const;
    void resume() const;
    void set_speed(double speed) const;
    void follow_system() const;

private:
    template <class Change>
    void change(Change change) const;

    std::shared_ptr<store::Store> store_;
};

}  // namespace tfdb
