// Random operations on the store, compared with the naive model, while snapshots are held.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
#include <random>
#include <set>

#include "tfdb/store/fixture.hpp"
#include "tfdb/store/naive_model.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb {
namespace {

using lookup::PolicyKind;
using naive::Member;

struct Shape {
    const char* name;
    std::optional<StampNs> history;
    int names;
    int stamps;  // stamps lie in [0, stamps), drifting upward by `drift` per operation
    double drift;
    int batch;       // most members of a batch
    double statics;  // shares of operations
    double removals;
    double clears;
    int operations;
    double held = 0.1;      // share of operations after which a snapshot is taken
    double orderly = 0.85;  // share of members that keep to a fixed forest
};

class Driver {
public:
    Driver(const Shape& shape, unsigned seed)
        : shape_(shape),
          seed_(seed),
          random_(seed),
          buffer_(options(shape)),
          model_(shape.history) {}

    void run() {
        for (int i = 0; i < shape_.operations && !failed_; ++i) {
            operate(i);
            if (numbered())
                CHECK_EQ(buffer_.commit(), model_.commit());
            if (chance(shape_.held))
                hold();
            for (int q = 0; q < 6; ++q)
                question(i);
        }
        if (!failed_ && !held_.empty())
            look_at_every_state();
    }

private:
    struct Held {
        Snapshot snapshot;
        std::size_t state;
    };

    static BufferOptions options(const Shape& shape) {
        BufferOptions o = fixture::defaults();
        o.history_ns = shape.history;
        return o;
    }
    bool chance(double p) { return std::uniform_real_distribution<>(0, 1)(random_) < p; }
    int below(int n) { return std::uniform_int_distribution<>(0, n - 1)(random_); }
    std::string name() { return "frame" + std::to_string(below(shape_.names)); }
    Pose pose() {
        std::normal_distribution<> normal;
        const geometry::Quat q{normal(random_), normal(random_), normal(random_), normal(random_)};
        return {{normal(random_), normal(random_), normal(random_)}, geometry::normalized(q)};
    }
    StampNs stamp(int operation) {
        return below(shape_.stamps) + static_cast<StampNs>(shape_.drift * operation);
    }

    void operate(int i) {
        const double kind = std::uniform_real_distribution<>(0, 1)(random_);
        if (kind < shape_.removals)
            return remove();
        if (kind < shape_.removals + shape_.clears) {
            buffer_.clear();
            model_.clear();
            return;
        }
        if (chance(0.01))
            (void)buffer_.compact();
        const bool is_static = chance(shape_.statics);
        std::vector<Member> batch(static_cast<std::size_t>(1 + below(shape_.batch)));
        for (Member& m : batch) {
            m = {name(), name(), stamp(i), pose()};
            // Mostly a fixed forest, sometimes another parent.
            if (chance(shape_.orderly))
                m.parent = m.child == "frame0" ? "root" : "frame0";
            if (chance(0.3) && m.child.back() > '2')
                m.parent = "frame1";
        }
        write(batch, is_static);
    }

    void write(const std::vector<Member>& batch, bool is_static) {
        std::vector<TransformView> views;
        for (const Member& m : batch)
            views.push_back({m.parent, m.child, m.stamp, m.pose});
        const bool partial = chance(0.3);
        const WriteRules rules{chance(0.2), !is_static && chance(0.2)};
        std::vector<RefusedMember> refused;
        try {
            if (partial) {
                const WriteResult result = buffer_.write({.transforms = views,
                                                          .is_static = is_static,
                                                          .authority = "driver",
                                                          .rules = rules,
                                                          .partial = true});
                refused = result.refused;
                CHECK_EQ(result.commit, buffer_.commit());
            } else {
                buffer_.set_transforms(views, is_static, "driver", rules);
            }
        } catch (const Error& error) {
            refused = error.detail().refused;
            CHECK(!partial && !refused.empty() && refused[0].code == error.code() &&
                  refused[0].index == error.detail().index);
        }
        const std::vector<Member> rest = judge(batch, is_static, rules, refused);
        if ((partial || refused.empty()) && !rest.empty())
            model_.set(rest, is_static);
    }

    /// Checks the refused members; returns the others.
    std::vector<Member> judge(const std::vector<Member>& batch, bool is_static, WriteRules rules,
                              const std::vector<RefusedMember>& refused) {
        std::map<std::size_t, ErrorCode> told;
        std::set<std::size_t> left_out;  // for a cycle: the next one of that stamp comes instead
        for (const RefusedMember& member : refused) {
            told[member.index] = member.code;
            if (member.code == ErrorCode::kCycle)
                left_out.insert(member.index);
        }
        const auto firsts = model_.faults(batch, is_static, rules);
        const auto faults = model_.faults(batch, is_static, rules, left_out);
        CHECK_EQ(told.size(), refused.size());
        CHECK(std::is_sorted(refused.begin(), refused.end(),
                             [](const auto& a, const auto& b) { return a.index < b.index; }));
        std::vector<Member> sound;
        std::vector<Member> rest;
        bool right = true;
        for (std::size_t i = 0; i < batch.size(); ++i) {
            const auto fault = faults.find(i);
            const auto found = told.find(i);
            if (firsts.count(i) == 0)
                sound.push_back(batch[i]);
            if (found == told.end())
                rest.push_back(batch[i]);
            const ErrorCode expected = fault == faults.end() ? ErrorCode::kCycle : fault->second;
            right =
                right && (found == told.end() ? fault == faults.end() : found->second == expected);
        }
        // Members are left out for a cycle only while one exists.
        const bool closes = !sound.empty() && model_.closes_cycle(sound, is_static);
        right = right && closes != left_out.empty() &&
                (rest.empty() || !model_.closes_cycle(rest, is_static));
        CHECK(right);
        if (!right)
            complain("refused the wrong members", batch);
        return rest;
    }

    void complain(const char* what, const std::vector<Member>& batch) {
        failed_ = true;
        std::printf("  %s seed %u: %s\n", shape_.name, seed_, what);
        for (const Member& m : batch) {
            std::printf("    %s<-%s at %lld\n", m.parent.c_str(), m.child.c_str(),
                        static_cast<long long>(m.stamp));
        }
        report(buffer_, model_.commit());
    }

    void remove() {
        const std::string victim = name();
        const bool recursive = chance(0.7);
        std::optional<ErrorCode> code;
        try {
            buffer_.remove_frame(victim, recursive);
        } catch (const Error& error) {
            code = error.code();
        }
        CHECK(code == model_.remove(victim, recursive));
    }

    void hold() {
        if (held_.size() > 3)
            held_.erase(held_.begin() + below(4));
        held_.push_back(std::make_unique<Held>(Held{buffer_.snapshot(), model_.commit()}));
    }

    void question(int operation) {
        const StoreReader* reads = &buffer_;
        std::size_t state = model_.commit();
        if (!held_.empty() && chance(0.5)) {
            const Held& h = *held_[static_cast<std::size_t>(below(static_cast<int>(held_.size())))];
            reads = &h.snapshot;
            state = h.state;
        }
        std::optional<Snapshot> later;
        if (reads != &buffer_ && numbered() && chance(0.5)) {
            const auto* const held = static_cast<const Snapshot*>(reads);
            state += static_cast<std::size_t>(below(static_cast<int>(model_.commit() - state) + 1));
            reads = &later.emplace(held->at(state));
        }
        if (chance(0.05))
            look_around(*reads, state, stamp(operation));
        const std::string target = chance(0.1) ? "root" : name();
        const std::string source = name();
        static constexpr PolicyKind kKinds[] = {PolicyKind::kInterpolate, PolicyKind::kInterpolate,
                                                PolicyKind::kExact,       PolicyKind::kPrevious,
                                                PolicyKind::kNearest,     PolicyKind::kExtrapolate,
                                                PolicyKind::kLatest};
        Policy policy{kKinds[below(7)], lookup::kNoLimit};
        if (policy.kind == PolicyKind::kExact || policy.kind == PolicyKind::kLatest) {
            policy.limit = lookup::kNoLimit;
        } else if (policy.kind == PolicyKind::kExtrapolate || chance(0.5)) {
            policy.limit = below(shape_.stamps);
        }
        std::optional<StampNs> at = stamp(operation);
        if (chance(0.25))
            at.reset();
        std::optional<StampNs> most;
        if (policy.kind == PolicyKind::kLatest && chance(0.5))
            most = below(shape_.stamps);
        const StampNs now = stamp(operation);
        const auto expected = policy.kind == PolicyKind::kLatest
                                  ? model_.lookup_latest(state, target, source, most, now)
                                  : model_.lookup(state, target, source, at, policy);
        const auto found = [&] {
            return policy.kind == PolicyKind::kLatest
                       ? reads->lookup_latest_transform(target, source, most, now)
                       : reads->lookup_transform(target, source, at, policy);
        };
        const bool agreed = ask(*reads, found, expected) &&
                            ask_full(*reads, state, target, at, source, policy) &&
                            agree_about_times(*reads, state, target, source, at);
        CHECK(agreed);
        if (agreed)
            return;
        report(*reads, state);
        failed_ = true;
        std::printf(
            "  %s seed %u operation %d: %s<-%s at %lld, policy %d limit %lld, state %zu of %zu\n",
            shape_.name, seed_, operation, target.c_str(), source.c_str(),
            static_cast<long long>(at.value_or(-1)), static_cast<int>(policy.kind),
            static_cast<long long>(policy.limit), state, model_.commit());
    }

    /// In `fine` each sample is a commit.
    static bool numbered() { return fixture::engine() != Concurrency::kFine; }

    /// From the oldest held state on, whichever snapshot is closed first.
    void look_at_every_state() {
        if (!numbered())
            return;
        std::unique_ptr<Snapshot> last;
        const auto first = held_.front()->state;
        for (std::size_t state = first; state <= model_.commit(); ++state) {
            const Snapshot& from = last != nullptr ? *last : held_.front()->snapshot;
            auto next = std::make_unique<Snapshot>(from.at(state));
            CHECK_EQ(next->commit(), state);
            if (state % 2 == 0) {
                last = std::move(next);
                held_.clear();
                look_around(*last, state, stamp(static_cast<int>(state)));
            } else {
                look_around(*next, state, stamp(static_cast<int>(state)));
                if (held_.empty())
                    last = std::move(next);
            }
        }
    }

    void report(const StoreReader& reads, std::size_t state) const {
        for (const std::string& frame : model_.frames(state)) {
            std::printf("    model %s\n    store %s\n",
                        describe(frame, model_.samples(state, frame)).c_str(),
                        describe(frame, reads.samples(frame)).c_str());
        }
    }

    bool agree_about_times(const StoreReader& reads, std::size_t state, const std::string& target,
                           const std::string& source, std::optional<StampNs> at) const {
        std::optional<std::pair<StampNs, StampNs>> times;
        std::optional<std::string> parent;
        try {
            parent = reads.parent_of(source, at).value_or("");
            const CommonTimes found = reads.common_times(target, source);
            times = {found.oldest, found.newest};
        } catch (const Error& error) {
            CHECK(error.code() == ErrorCode::kUnknownFrame ||
                  error.code() == ErrorCode::kDisconnected);
        }
        const auto expected = model_.common_times(state, target, source);
        if (times != expected) {
            const auto want = expected.value_or(std::pair<StampNs, StampNs>{-1, -1});
            const auto got = times.value_or(std::pair<StampNs, StampNs>{-1, -1});
            std::printf("  covered from %lld to %lld, expected %lld to %lld\n",
                        static_cast<long long>(got.first), static_cast<long long>(got.second),
                        static_cast<long long>(want.first), static_cast<long long>(want.second));
        }
        return times == expected && parent == model_.parent_of(state, source, at);
    }

    /// Frames, their samples and information, and the tree at a stamp.
    void look_around(const StoreReader& reads, std::size_t state, StampNs at) const {
        const std::vector<std::string> names = model_.frames(state);
        CHECK(reads.frames() == names);
        const std::vector<FrameInfo> tree = reads.tree(at);
        CHECK_EQ(tree.size(), names.size());
        for (std::size_t i = 0; i < names.size() && i < tree.size(); ++i) {
            const Samples samples = reads.samples(names[i]);
            const Samples expected = model_.samples(state, names[i]);
            CHECK(samples.stamps == expected.stamps && samples.parents == expected.parents);
            for (std::size_t s = 0; s < expected.poses.size() && s < samples.poses.size(); ++s)
                CHECK(fixture::apart(samples.poses[s], expected.poses[s]) < 1e-12);
            const FrameInfo told = reads.frame_info(names[i]);
            const FrameInfo wanted = model_.info(state, names[i]);
            CHECK(told.name == wanted.name && told.parent == wanted.parent);
            CHECK(told.is_static == wanted.is_static && told.samples == wanted.samples);
            CHECK(told.oldest == wanted.oldest && told.newest == wanted.newest);
            CHECK(told.longest_gap == wanted.longest_gap && told.cleared == wanted.cleared);
            CHECK_EQ(tree[i].name, names[i]);
            CHECK_EQ(tree[i].parent.value_or(""), model_.parent_of(state, names[i], at).value());
        }
    }

    /// A lookup through a fixed frame; any of the three frames may be unknown.
    bool ask_full(const StoreReader& reads, std::size_t state, const std::string& target,
                  std::optional<StampNs> at, const std::string& source, Policy policy) {
        if (policy.kind == PolicyKind::kLatest || !chance(0.3))
            return true;
        const std::string fixed = name();
        std::optional<StampNs> then = at ? *at / 2 : StampNs{below(shape_.stamps)};
        if (chance(0.2))
            then.reset();
        return ask(
            reads,
            [&] { return reads.lookup_transform_full(target, at, source, then, fixed, policy); },
            model_.lookup_full(state, target, at, source, then, fixed, policy));
    }

    template <class Find>
    static bool ask(const StoreReader& reads, const Find& find, const naive::Reply& expected) {
        std::optional<ErrorCode> code;
        Answer answer;
        ErrorDetail detail;
        try {
            answer = find();
        } catch (const Error& error) {
            code = error.code();
            detail = error.detail();
        }
        if (code != expected.error) {
            std::printf("  got error %d, expected %d\n", code ? static_cast<int>(*code) : -1,
                        expected.error ? static_cast<int>(*expected.error) : -1);
            return false;
        }
        return code ? says_the_same(*code, detail, expected.detail) : same(reads, answer, expected);
    }

    static bool says_the_same(ErrorCode code, const ErrorDetail& got, const ErrorDetail& want) {
        if (code == ErrorCode::kUnknownFrame)
            return got.frame == want.frame;
        if (code == ErrorCode::kDisconnected) {
            if (got.frames != want.frames)
                std::printf("  roots %s and %s, expected %s and %s\n", got.frames.at(0).c_str(),
                            got.frames.at(1).c_str(), want.frames.at(0).c_str(),
                            want.frames.at(1).c_str());
            return got.frames == want.frames;
        }
        const bool same =
            got.edge == want.edge && got.parent == want.parent && got.stamp == want.stamp &&
            got.newest == want.newest && got.limit == want.limit &&
            (!want.oldest ||
             (got.oldest == want.oldest && got.before == want.before && got.after == want.after));
        if (!same || (code == ErrorCode::kExtrapolation && got.reason != want.reason)) {
            std::printf("  error %d is told of %s at %lld, expected of %s at %lld\n",
                        static_cast<int>(code), got.edge.c_str(),
                        static_cast<long long>(got.stamp.value_or(-1)), want.edge.c_str(),
                        static_cast<long long>(want.stamp.value_or(-1)));
            return false;
        }
        return true;
    }

    static std::string describe(const std::string& frame, const Samples& samples) {
        std::string text = frame + ":";
        for (std::size_t i = 0; i < samples.stamps.size(); ++i) {
            const StampNs stamp = samples.stamps[i];
            text += " " + (stamp < 0 ? std::string("static") : std::to_string(stamp)) + ">" +
                    samples.parents[i];
        }
        return text;
    }

    static bool same(const StoreReader& reads, const Answer& answer, const naive::Reply& expected) {
        const double* got = &answer.pose.translation.x;
        const double* want = &expected.pose.translation.x;
        double apart = 0;
        double dot = 0;
        for (int i = 0; i < 3; ++i)
            apart = std::max(apart, std::abs(got[i] - want[i]));
        for (int i = 3; i < 7; ++i)
            dot += got[i] * want[i];
        if (answer.stamp != expected.stamp || apart > 1e-9 || std::abs(std::abs(dot) - 1) > 1e-12) {
            std::printf("  stamps %lld and %lld, %g m and a quaternion product of %.17g apart\n",
                        static_cast<long long>(answer.stamp),
                        static_cast<long long>(expected.stamp), apart, dot);
            return false;
        }
        std::vector<naive::Use> edges;
        for (const EdgeUse& use : answer.edges) {
            edges.push_back({reads.frame_name(use.child, use.generation),
                             reads.frame_name(use.parent, use.parent_generation), use.used,
                             use.before, use.after, use.inverted});
        }
        if (edges != expected.edges)
            std::puts("  other edges, or used otherwise");
        return edges == expected.edges;
    }

    Shape shape_;
    unsigned seed_;
    bool failed_ = false;
    std::mt19937 random_;
    Buffer buffer_;
    naive::Model model_;
    std::vector<std::unique_ptr<Held>> held_;
};

void run_shape(const Shape& shape) {
    const char* more = std::getenv("TFDB_MODEL_SEEDS");
    const unsigned seeds = more != nullptr ? static_cast<unsigned>(std::atoi(more)) : 6;
    std::printf("  model %s: seeds 1..%u\n", shape.name, seeds);
    for (unsigned seed = 1; seed <= seeds; ++seed)
        Driver(shape, seed).run();
}

}  // namespace

TFDB_TEST(model_small_history) {
    run_shape({"small history", 40, 6, 60, 0.3, 3, 0.1, 0.03, 0.01, 400});
}
TFDB_TEST(model_everything_kept) {
    run_shape({"everything kept", std::nullopt, 6, 60, 0.1, 3, 0.1, 0.02, 0.005, 400});
}
TFDB_TEST(model_very_late) {
    run_shape({"very late", std::nullopt, 4, 2000, 0.0, 6, 0.02, 0.002, 0.002, 300});
}
TFDB_TEST(model_evicting) {
    run_shape({"evicting", 30, 4, 20, 2.0, 3, 0.02, 0.005, 0.002, 500});
}
// Without snapshots, samples are evicted and slots reused freely.
TFDB_TEST(model_evicting_with_no_snapshot_held) {
    run_shape({"evicting, none held", 30, 4, 20, 2.0, 3, 0.02, 0.005, 0.002, 800, 0.0});
}
TFDB_TEST(model_many_removals_with_no_snapshot_held) {
    run_shape({"many removals, none held", 60, 7, 50, 0.5, 3, 0.15, 0.25, 0.02, 600, 0.0});
}
TFDB_TEST(model_repeated_stamps_with_no_snapshot_held) {
    run_shape({"repeated stamps, none held", 500, 4, 6, 0.05, 4, 0.02, 0.01, 0.002, 800, 0.0});
}
TFDB_TEST(model_many_cycles) {
    run_shape({"many cycles", 100, 5, 30, 0.3, 8, 0.1, 0.05, 0.01, 300, 0.05, 0.4});
}
TFDB_TEST(model_many_removals) {
    run_shape({"many removals", 100, 7, 50, 0.2, 3, 0.15, 0.25, 0.02, 400});
}

}  // namespace tfdb
