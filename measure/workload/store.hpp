// What a store must offer to be measured: tfdb with each of its engines, and the real tf2.
#pragma once

#include <concepts>
#include <cstdint>
#include <optional>

#include "forest.hpp"
#include "motion.hpp"

namespace tfdb::driver {

/// The stamps of the samples that an answer was made from.
struct Used {
    std::int64_t oldest = -1;
    std::int64_t newest = -1;
};

/// What a store counts itself, since it was made. What it does not count stays 0.
struct StoreCounters {
    std::uint64_t commits = 0;
    std::uint64_t aborts = 0;
    std::uint64_t conflicts = 0;
    std::uint64_t retries = 0;
    std::uint64_t lock_waits = 0;
    std::uint64_t lapped_reads = 0;
    std::uint64_t pinned_reads = 0;
};

/// A Worker belongs to one thread. A null `used` is one that nobody wants to know. All but the last
/// two calls are timed, so none may allocate where the store itself does not. `lost` counts
/// attempts that ended in a conflict.
template <class S>
concept Store = requires(S store, typename S::Worker worker, const Path& path, Used* wanted,
                         Used& used, std::uint32_t run, std::int64_t stamp, std::uint64_t& lost,
                         Pose& pose, std::optional<std::int64_t> at) {
    requires std::constructible_from<S, const Options&, const Forest&, const Motion&>;
    requires std::constructible_from<typename S::Worker, S&>;
    /// False where the store has no answer.
    { worker.read(path, wanted) } -> std::same_as<bool>;
    { worker.read_in_transaction(path, wanted, lost) } -> std::same_as<bool>;
    /// False where the store refuses.
    { worker.write_batch(run, stamp) } -> std::same_as<bool>;
    { worker.write_singly(run, stamp) } -> std::same_as<bool>;
    { worker.modify(run, stamp, lost) } -> std::same_as<bool>;
    /// Every edge at one stamp.
    {store.fill(stamp)};
    /// T[low<-high] at a stamp, or of the newest samples; throws where there is none.
    { store.probe(path, at, used) } -> std::same_as<Pose>;
    { store.counters() } -> std::same_as<StoreCounters>;
};

}  // namespace tfdb::driver
