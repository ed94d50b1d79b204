// tfdb under the workload, through nothing but its public interface.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "store.hpp"
#include "tfdb/store/buffer.hpp"
#include "tfdb/store/transaction.hpp"

namespace tfdb::driver {

// Threads: any. Guarantee: adds no lock and no allocation to what the Buffer does.
class TfdbStore {
public:
    class Worker;
    static constexpr bool kNewestOfEachEdge = true;
    static constexpr std::uint32_t kDeepestWalk = kMaxFrames;

    TfdbStore(const Options& options, const Forest& forest, const Motion& motion)
        : options_(options), forest_(forest), motion_(motion), buffer_(buffer_options(options)) {}

    void fill(std::int64_t stamp) {
        constexpr std::uint32_t kAtOnce = 4'096;
        std::vector<TransformView> batch;
        for (std::uint32_t first = 1; first <= forest_.edges(); first += kAtOnce) {
            batch.clear();
            const std::uint32_t end = std::min(first + kAtOnce, forest_.edges() + 1);
            for (std::uint32_t frame = first; frame < end; ++frame) {
                batch.push_back(view_of(frame, stamp));
            }
            buffer_.set_transforms(batch, false, kAuthority);
        }
        if (handles_.empty()) {
            handles_.resize(forest_.edges() + 1);
            for (std::uint32_t frame = 0; frame <= forest_.edges(); ++frame) {
                if (!buffer_.find_frame(forest_.name(frame), handles_[frame])) {
                    throw std::runtime_error("the forest was not stored");
                }
            }
        }
    }

    [[nodiscard]] Pose probe(const Path& path, std::optional<std::int64_t> at, Used& used) {
        const std::string& target = forest_.name(path.low);
        const std::string& source = forest_.name(path.high);
        const Answer answer = at ? buffer_.lookup_transform(target, source, *at)
                                 : buffer_.lookup_latest_transform(target, source);
        used = used_in(answer);
        return answer.pose;
    }

    [[nodiscard]] StoreCounters counters() {
        const Counters now = buffer_.counters();
        return {now.commits,    now.aborts,       now.conflicts,   now.retries,
                now.lock_waits, now.lapped_reads, now.pinned_reads};
    }

private:
    static constexpr std::string_view kAuthority = "driver";

    static BufferOptions buffer_options(const Options& options) {
        BufferOptions result;
        result.history_ns = static_cast<StampNs>(1e9 * options.history_seconds());
        try {
            result.concurrency = concurrency_of(options.engine);
        } catch (const Error& error) {
            throw BadOption(error.what());
        }
        return result;
    }

    [[nodiscard]] TransformView view_of(std::uint32_t frame, std::int64_t stamp) const {
        return {forest_.name(forest_.parent(frame)), forest_.name(frame), stamp,
                motion_.at(frame, stamp)};
    }

    static Used used_in(const Answer& answer) {
        Used used{answer.edges.front().before, answer.edges.front().after};
        for (const EdgeUse& edge : answer.edges) {
            used.oldest = std::min(used.oldest, edge.before);
            used.newest = std::max(used.newest, edge.after);
        }
        return used;
    }

    const Options& options_;
    const Forest& forest_;
    const Motion& motion_;
    Buffer buffer_;
    std::vector<FrameHandle> handles_;
};

// Threads: one. Guarantee: as its store's.
class TfdbStore::Worker {
public:
    explicit Worker(TfdbStore& store)
        : store_(store), climbs_(store.options_.opposite == store.options_.from_low) {
        batch_.resize(store.options_.write_length);
    }

    bool read(const Path& path, Used* used) {
        const auto [target, source] = ends(path);
        const FrameHandle to = store_.handles_[target];
        const FrameHandle from = store_.handles_[source];
        const bool found =
            store_.options_.time == Time::kLatest
                ? store_.buffer_.ask(tfdb::store::of_newest(to, from, std::nullopt, 0), answer_,
                                     failure_)
                : store_.buffer_.ask(tfdb::store::at_stamp(to, from, std::nullopt, {}), answer_,
                                     failure_);
        note(found, used);
        return found;
    }

    bool read_in_transaction(const Path& path, Used* used, std::uint64_t& lost) {
        const auto [target, source] = ends(path);
        const std::string& to = store_.forest_.name(target);
        const std::string& from = store_.forest_.name(source);
        bool found = false;
        until_committed(lost, [&](Transaction& transaction) {
            found = store_.options_.time == Time::kLatest
                        ? transaction.ask(tfdb::store::of_newest(to, from, std::nullopt, 0),
                                          answer_, failure_)
                        : transaction.ask(tfdb::store::at_stamp(to, from, std::nullopt, {}),
                                          answer_, failure_);
        });
        note(found, used);
        return found;
    }

    bool write_batch(std::uint32_t run, std::int64_t stamp) {
        fill_batch(run, stamp);
        return store([&] { store_.buffer_.set_transforms(batch_, false, kAuthority); });
    }

    bool write_singly(std::uint32_t run, std::int64_t stamp) {
        fill_batch(run, stamp);
        return store([&] {
            for (const TransformView& one : batch_) {
                store_.buffer_.set_transform(one, false, kAuthority);
            }
        });
    }

    /// Reads the newest pose of each edge of the run, then writes them all.
    bool modify(std::uint32_t run, std::int64_t stamp, std::uint64_t& lost) {
        fill_batch(run, stamp);
        return store([&] {
            until_committed(lost, [&](Transaction& transaction) {
                for (const TransformView& one : batch_) {
                    if (!transaction.ask(
                            tfdb::store::of_newest(one.parent, one.child, std::nullopt, 0), answer_,
                            failure_)) {
                        throw std::runtime_error("an edge was lost");
                    }
                }
                transaction.set_transforms(batch_, false, kAuthority);
            });
        });
    }

private:
    /// After so many lost attempts a transaction runs alone, and then it cannot lose.
    static constexpr unsigned kPatience = 8;

    [[nodiscard]] std::pair<std::uint32_t, std::uint32_t> ends(const Path& path) const {
        return store_.options_.from_low ? std::pair{path.high, path.low}
                                        : std::pair{path.low, path.high};
    }

    void note(bool found, Used* used) const {
        if (found && used != nullptr) {
            *used = used_in(answer_);
        }
    }

    void fill_batch(std::uint32_t run, std::int64_t stamp) {
        const auto length = static_cast<std::uint32_t>(batch_.size());
        for (std::uint32_t i = 0; i < length; ++i) {
            const std::uint32_t frame = climbs_ ? run + length - i : run + 1 + i;
            batch_[i] = store_.view_of(frame, stamp);
        }
    }

    /// False where the store refuses, e.g. a stamp that is older than its history by now.
    template <class Write>
    bool store(const Write& write) {
        try {
            write();
            return true;
        } catch (const Error&) {
            return false;
        }
    }

    template <class Body>
    void until_committed(std::uint64_t& lost, const Body& body) {
        TransactionOptions options;
        for (unsigned attempt = 0;; ++attempt) {
            options.alone = attempt >= kPatience;
            Transaction transaction(store_.buffer_, options);
            options.age = transaction.age();
            try {
                body(transaction);
                transaction.commit();
                return;
            } catch (const Conflict&) {
                ++lost;
            }
            pause(attempt);
        }
    }

    static void pause(unsigned attempt) {
        if (attempt < 2) {
            std::this_thread::yield();
        } else {
            std::this_thread::sleep_for(std::chrono::microseconds(1U << std::min(attempt, 8U)));
        }
    }

    TfdbStore& store_;
    bool climbs_;  // a batch begins at the high end, where a lookup from there begins too
    std::vector<TransformView> batch_;
    Answer answer_;
    Failure failure_;
};

}  // namespace tfdb::driver
