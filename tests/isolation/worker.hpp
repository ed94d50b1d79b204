// One thread of the recorder: random lookups, batches, removals and transactions, all recorded.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "history.hpp"
#include "tfdb/store/transaction.hpp"
#include "world.hpp"

namespace tfdb::recorder {

struct Options {
    std::string engine = "snapshot";
    unsigned threads = 4;
    unsigned processes = 0;  // instead of threads, in a store that they share
    unsigned writers = ~0U;  // only the first ones write
    std::size_t operations = 2000;
    unsigned seed = 1;
    bool batches = true;  // false: every member of a batch is a call of its own
    bool transactions = true;
    bool commits = true;  // whether commit numbers are recorded
    std::string out;
};

/// Threads: one each. Guarantee: blocking, as the store.
class Worker {
public:
    Worker(Buffer& buffer, Shared& shared, const Options& options, unsigned thread)
        : buffer_(buffer),
          values_(shared),
          clock_(shared.clock),
          options_(options),
          thread_(thread),
          random_(options.seed * 1000003U + thread),
          decoder_(values_) {}
    Worker(const Worker&) = delete;
    Worker& operator=(const Worker&) = delete;

    void run() {
        for (std::size_t i = 0; i < options_.operations && !values_.full(); ++i)
            step();
    }
    [[nodiscard]] const std::vector<Operation>& history() const { return history_; }

private:
    using Path = std::vector<std::pair<std::string, std::string>>;
    enum class Kind : std::uint8_t { kLatest, kPrevious, kInterpolated, kCommon };

    int below(int n) { return std::uniform_int_distribution<>(0, n - 1)(random_); }
    bool chance(int percent) { return below(100) < percent; }

    static std::int64_t now() {
        return std::chrono::duration_cast<std::chrono::nanoseconds>(
                   std::chrono::steady_clock::now().time_since_epoch())
            .count();
    }

    void step() {
        operation_ = {};
        (options_.processes > 0 ? operation_.process : operation_.thread) = thread_;
        const int kind = below(100);
        const bool may_write = thread_ < options_.writers;
        if (kind < 25 && options_.transactions)
            return transaction(may_write);
        if (kind < 30)
            return snapshot();
        if (!may_write || kind < 60)
            return lookup();
        if (kind < 66)
            return revise();
        if (kind < 70)
            return come_or_go();
        write();
    }

    void finish(std::int64_t begin) {
        operation_.begin = begin;
        operation_.end = now();
        history_.push_back(std::move(operation_));
    }

    // -- lookups

    std::pair<std::string, std::string> two_frames() {
        for (;;) {
            const int last = static_cast<int>(kEdges.size());
            const int i = below(last + 1);
            const int j = below(last + 1);
            const bool crowded = i < last && j < last && kEdges[at(i)].digit == 2 &&
                                 kEdges[at(j)].digit == 2;  // no digits for both
            if (i != j && !crowded)
                return {i == last ? "map" : kEdges[at(i)].name,
                        j == last ? "map" : kEdges[at(j)].name};
        }
    }
    static std::size_t at(int i) { return static_cast<std::size_t>(i); }

    struct Question {
        std::string target;
        std::string source;
        Kind kind;
        StampNs stamp;
    };
    Question question() {
        auto [target, source] = two_frames();
        const auto kind = static_cast<Kind>(below(4));
        return {target, source, kind, clock_.load() - below(60)};
    }

    template <class Source>
    static bool ask(Source& from, const Question& q, Answer& answer, Failure& failure,
                    const FrameHandle& target, const FrameHandle& source) {
        const Policy policy{q.kind == Kind::kPrevious ? lookup::PolicyKind::kPrevious
                                                      : lookup::PolicyKind::kInterpolate};
        if (q.kind == Kind::kLatest)
            return from.ask(store::of_newest(target, source, std::nullopt, 0), answer, failure);
        std::optional<StampNs> stamp;
        if (q.kind != Kind::kCommon)
            stamp = q.stamp;
        return from.ask(store::at_stamp(target, source, stamp, policy), answer, failure);
    }
    static bool ask(Transaction& from, const Question& q, Answer& answer, Failure& failure) {
        const Policy policy{q.kind == Kind::kPrevious ? lookup::PolicyKind::kPrevious
                                                      : lookup::PolicyKind::kInterpolate};
        if (q.kind == Kind::kLatest)
            return from.ask(store::of_newest(q.target, q.source, std::nullopt, 0), answer, failure);
        std::optional<StampNs> stamp;
        if (q.kind != Kind::kCommon)
            stamp = q.stamp;
        return from.ask(store::at_stamp(q.target, q.source, stamp, policy), answer, failure);
    }

    /// Names of the answer's edges, asked at once: slots are reused.
    template <class Source>
    static Path path_of(const Source& from, const Answer& answer) {
        Path path;
        for (const EdgeUse& use : answer.edges) {
            path.emplace_back(from.frame_name(use.child, use.generation),
                              from.frame_name(use.parent, use.parent_generation));
        }
        return path;
    }

    void lookup() {
        const Question q = question();
        FrameHandle target;
        FrameHandle source;
        Answer answer;
        Failure failure;
        const std::int64_t begin = now();
        for (const auto& [name, handle] :
             {std::pair{&q.target, &target}, std::pair{&q.source, &source}}) {
            if (!buffer_.find_frame(*name, *handle)) {
                note_absence(*name);
                return finish(begin);
            }
        }
        const bool found = ask(buffer_, q, answer, failure, target, source);
        const std::int64_t end = now();
        const Path path = found ? path_of(buffer_, answer) : Path{};
        if (!note(q, found, answer, failure, path))
            return;
        operation_.begin = begin;
        operation_.end = end;
        history_.push_back(std::move(operation_));
    }

    /// A few lookups of one state.
    void snapshot() {
        const std::int64_t begin = now();
        const Snapshot held = buffer_.snapshot();
        const Question first = question();
        for (int i = 0; i < 3; ++i) {
            const Question q = i == 2 ? first : i == 1 ? question() : first;
            FrameHandle target;
            FrameHandle source;
            Answer answer;
            Failure failure;
            if (!held.find_frame(q.target, target)) {
                note_absence(q.target);
            } else if (!held.find_frame(q.source, source)) {
                note_absence(q.source);
            } else {
                const bool found = ask(held, q, answer, failure, target, source);
                note(q, found, answer, failure, found ? path_of(held, answer) : Path{});
            }
            if (chance(30))
                std::this_thread::yield();
        }
        operation_.as_of = held.commit();
        if (!operation_.reads.empty())
            finish(begin);
    }

    void note_absence(const std::string& name) {
        operation_.reads.push_back({name, std::nullopt, "null", "", operation_.writes.size()});
    }

    std::string shown(std::size_t edge, std::int64_t number) const {
        return std::string("\"") + kEdges[edge].name + "#" + std::to_string(number) + "\"";
    }

    /// Adds what the lookup saw; false if it says nothing.
    bool note(const Question& q, bool found, const Answer& answer, const Failure& failure,
              const Path& path) {
        if (!found) {
            if (failure.code != ErrorCode::kUnknownFrame)
                return false;
            if (options_.commits)
                operation_.as_of = failure.commit;
            note_absence(failure.argument == 0 ? q.target : q.source);
            return true;
        }
        for (const auto& [child, parent] : path) {
            // A frame that was removed meanwhile has no name any more: nothing can be said.
            if (!edge_of(child) || (parent != "map" && !edge_of(parent)))
                return false;
        }
        if (options_.commits)
            operation_.as_of = answer.commit;
        std::vector<Part> parts;
        if (!decoder_.decode(answer, q.target, q.source, path, parts)) {
            operation_.reads.push_back({path.empty() ? "map" : path.front().first, std::nullopt,
                                        "\"a pose of no state\"", "", 0});
            return true;
        }
        for (const Part& part : parts)
            note(q, answer, part, parts);
        return true;
    }

    void note(const Question& q, const Answer& answer, const Part& part,
              const std::vector<Part>& parts) {
        if (part.before == kUnknown)
            return;
        Seen seen{kEdges[part.edge].name, answer.stamp, shown(part.edge, part.before), "",
                  operation_.writes.size()};
        if (part.used == lookup::Used::kInterpolated)
            seen.after = shown(part.edge, part.after);
        if (part.used == lookup::Used::kLatest || part.used == lookup::Used::kStatic)
            seen.stamp.reset();
        operation_.reads.push_back(seen);
        if (q.kind == Kind::kCommon && part.used == lookup::Used::kExact) {
            // Whose newest sample is the only one at the common time has set it; below a frame that
            // had another parent then, an edge may have that is not on the path.
            const auto exact = [](const Part& p) { return p.used == lookup::Used::kExact; };
            const auto moves = [](const Part& p) { return p.edge == kTool; };
            if (std::count_if(parts.begin(), parts.end(), exact) == 1 &&
                std::none_of(parts.begin(), parts.end(), moves)) {
                seen.stamp.reset();
                operation_.reads.push_back(seen);
            }
        }
    }

    // -- writes

    struct Batch {
        std::vector<std::string> children;
        std::vector<std::string> parents;
        std::vector<TransformView> members;
        std::vector<Written> writes;
    };

    void add(Batch& batch, std::size_t edge, StampNs stamp, const std::string& parent) {
        const bool fixed = kEdges[edge].is_static;
        const std::int64_t value = values_.add(edge, fixed ? -1 : stamp, parent);
        batch.children.emplace_back(kEdges[edge].name);
        batch.parents.push_back(parent);
        batch.members.push_back({{}, {}, fixed ? 0 : stamp, pose_of(kEdges[edge], value)});
        Written written{kEdges[edge].name, shown(edge, value), stamp, parent, false};
        if (fixed)
            written.stamp.reset();
        batch.writes.push_back(written);
    }
    static void point(Batch& batch) {
        for (std::size_t i = 0; i < batch.members.size(); ++i) {
            batch.members[i].parent = batch.parents[i];
            batch.members[i].child = batch.children[i];
        }
    }

    /// Moving edges in any order, some twice, some late; now and then the tool's other parent.
    Batch moving_batch() {
        Batch batch;
        const int count = 1 + below(4);
        for (int i = 0; i < count; ++i) {
            const std::size_t edge = std::array<std::size_t, 5>{0, 2, 3, 5, kTool}[at(below(5))];
            StampNs stamp = clock_.fetch_add(1 + below(8)) + 1;
            if (chance(10))
                stamp -= below(40);
            std::string parent = kEdges[edge].parent;
            if (edge == kTool)
                parent = chance(25) ? "b3" : "a3";
            add(batch, edge, stamp, parent);
            if (chance(15))
                add(batch, edge, stamp + (chance(50) ? 0 : 1), parent);
        }
        point(batch);
        return batch;
    }

    void commit(const Batch& batch, bool is_static) {
        operation_.writes = batch.writes;
        CommitNumber number = 0;
        const std::int64_t begin = now();
        try {
            if (options_.batches) {
                number = buffer_.set_transforms(batch.members, is_static, "recorder");
            } else {
                for (const TransformView& member : batch.members) {
                    number = buffer_.set_transform(member, is_static, "recorder");
                    std::this_thread::yield();
                }
            }
        } catch (const Error&) {
            operation_.status = options_.batches ? "aborted" : "unknown";
        }
        if (options_.commits && number != 0)
            operation_.commit = number;
        finish(begin);
    }
    void write() { commit(moving_batch(), false); }
    void revise() {
        Batch batch;
        for (const std::size_t edge : {std::size_t{4}, std::size_t{1}})
            add(batch, edge, -1, kEdges[edge].parent);
        point(batch);
        commit(batch, true);
    }

    void come_or_go() {
        const std::size_t edge = 7 + at(below(2));
        const std::string name = kEdges[edge].name;
        if (chance(50)) {
            Batch batch;
            add(batch, edge, clock_.fetch_add(1) + 1, kEdges[edge].parent);
            point(batch);
            return commit(batch, false);
        }
        const std::int64_t value = values_.add(edge, -1, "");
        operation_.writes.push_back({name, shown(edge, value), std::nullopt, "", true});
        const std::int64_t begin = now();
        try {
            const CommitNumber number = buffer_.remove_frame(name, false);
            if (options_.commits)
                operation_.commit = number;
        } catch (const UnknownFrame&) {
            operation_.writes.clear();
            note_absence(name);
        }
        finish(begin);
    }

    // -- transactions

    void ask_in(Transaction& tx, const Question& q) {
        Answer answer;
        Failure failure;
        const bool found = ask(tx, q, answer, failure);
        note(q, found, answer, failure, found ? path_of(tx, answer) : Path{});
    }

    void transaction(bool may_write) {
        const std::int64_t begin = now();
        bool open = false;
        try {
            Transaction tx(buffer_);
            open = true;
            const Question first = question();
            ask_in(tx, first);
            if (chance(50))
                std::this_thread::yield();
            if (may_write && chance(80)) {
                const Batch batch = moving_batch();
                // What is read before the write is what the write may rest on.
                for (const std::string& child : batch.children)
                    ask_in(tx, {"map", child, Kind::kLatest, 0});
                tx.set_transforms(batch.members, false, "recorder");
                operation_.writes = batch.writes;
            }
            ask_in(tx, chance(50) ? first : question());
            const CommitNumber number = tx.commit();
            if (options_.commits && !operation_.writes.empty())
                operation_.commit = number;
        } catch (const Conflict&) {
            operation_.status = "aborted";
        } catch (const TooOld&) {
            operation_.status = "aborted";
        }
        if (open)
            finish(begin);
    }

    Buffer& buffer_;
    Values values_;
    std::atomic<StampNs>& clock_;
    const Options& options_;
    unsigned thread_;
    std::mt19937_64 random_;
    Decoder decoder_;
    Operation operation_;
    std::vector<Operation> history_;
};

}  // namespace tfdb::recorder
