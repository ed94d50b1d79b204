// Sessions of one engine on a small store, as programs for the walker.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "tfdb/engines/retry.hpp"
#include "tfdb/testing/sched/flaws.hpp"
#include "tfdb/txn/forest.sched.hpp"

namespace tfdb {

template <>
struct txn::SyncTuning<txn::forest::ForestMemory> {
    static constexpr unsigned kSlots = 3;
    static constexpr int kSpins = 0;
    static constexpr int kAttemptsBeforeAlone = 1;
    static constexpr int kWaitsBeforeRetry = 8;
    static constexpr bool kAwaitsChange = false;
};

namespace txn::engines {

using clock::StampNs;
using forest::ForestMemory;
using forest::WalkedForest;
using Item = PlainBatch<ForestMemory>::Item;

// Frames are numbered in order of creation; map <- odom <- base at 10, each edge's sample of step
// 0.
inline constexpr FrameId kMap = 0;
inline constexpr FrameId kOdom = 1;
inline constexpr FrameId kBase = 2;

inline void require(bool holds, const char* text) {
    sched::Run::require(holds, text, "engines", 0);
}

/// The lock rule of a two-phase locking session; other engines ignore it.
template <class S>
constexpr LockRule rule_of() {
    if constexpr (requires { S::kRule; })
        return S::kRule;
    else
        return {};
}

// The store of one execution. The walked threads only call `read`, `write` and similar functions,
// each with its own number.
template <class S>
struct Stage {
    Stage() {
        forest::name_words(store);
        (void)store.apply(chain(10), 0);
        (void)store.apply(chain(11), 1);  // reserves space for the following samples, as is typical
        shared.event_word.rename("event", 0);
        shared.gate.gate().rename("gate", 0);
        for (unsigned slot = 0; slot < SyncTuning<ForestMemory>::kSlots; ++slot) {
            shared.gate.claimed(slot).rename("slot", slot + 1);
            shared.gate.age(slot).rename("age", slot + 1);
            shared.gate.state(slot).rename("state", slot + 1);
        }
    }

    static forest::Step chain(StampNs stamp) {
        return {forest::Step::kSet, {{"map", "odom", stamp}, {"odom", "base", stamp}}, {}};
    }
    static SessionOptions in_slot(unsigned thread, std::uint64_t age = 0) {
        SessionOptions options;
        options.slot = thread;
        options.age = age;
        return options;
    }

    /// The newest stamps of both edges, upward from base, or downward.
    void read(unsigned thread, bool downward = false) {
        S session(shared, in_slot(thread));
        lookup::Answer answer;
        lookup::Failure failure;
        CommitNumber as_of = 0;
        const auto outcome = read_through(session, as_of, [&](const auto& view) {
            return downward ? lookup::lookup_latest(view, kBase, kMap, {}, 0, answer, failure)
                            : lookup::lookup_latest(view, kMap, kBase, {}, 0, answer, failure);
        });
        require(outcome == lookup::Outcome::kOk, "an answer");
        require(answer.edges.size() == 2, "the path");
        require(answer.edges[0].before == answer.edges[1].before, "both edges of one batch");
    }

    /// One batch on both edges. `frames` in locking order. `breaks`: memory is too short for the
    /// second edge's samples, so the commit number does not change.
    CommitNumber write(unsigned thread, StampNs stamp,
                       const std::vector<FrameId>& frames = {kOdom, kBase}, bool breaks = false) {
        S session(shared, in_slot(thread));
        PlainBatch<ForestMemory> batch;
        batch.frames = frames;
        for (const FrameId id : {kOdom, kBase}) {
            Item item;
            item.child = id;
            item.sample = sample(id - 1, stamp);
            batch.items.push_back(item);
        }
        for (StampNs more = 1; breaks && more < kMoreThanFit; ++more) {
            batch.items.push_back(batch.items.back());
            batch.items.back().sample.stamp = stamp + more;
        }
        try {
            return write_through(
                session,
                [&](CommitNumber& number) {
                    return beside(session, batch, number, [](const Item&) {});
                },
                [&] {
                    if (breaks)
                        throw CapacityExceeded("alone");
                    (void)store.apply(chain(stamp), static_cast<std::size_t>(stamp));
                    return shared.committed();
                });
        } catch (const CapacityExceeded&) {
            require(breaks, "nothing else throws");
            return 0;
        }
    }

    /// Reads one edge's newest stamp and stores the next one: two calls must not read the same
    /// stamp.
    void increment(unsigned thread, FrameId child) {
        S session(shared, in_slot(thread));
        (void)write_through(
            session,
            [&](CommitNumber& number) {
                PlainBatch<ForestMemory> batch;
                batch.frames = {child};
                batch.items.resize(1);
                batch.items[0].child = child;
                StampNs newest = 0;
                if (!newest_of(session, child, newest))
                    return Written::kGiveUp;
                batch.items[0].sample = sample(child - 1, newest + 1);
                return beside(session, batch, number, [](const Item&) {});
            },
            [&] {
                // Earlier concurrent reads are void here.
                StampNs newest = 0;
                require(newest_of(session, child, newest), "who is alone is not refused");
                const auto& name = child == kOdom ? "odom" : "base";
                const auto& parent = child == kOdom ? "map" : "odom";
                (void)store.apply({forest::Step::kSet, {{parent, name, newest + 1}}, {}}, 7);
                return shared.committed();
            });
    }

    /// A new frame, and both edges in the same commit: runs alone.
    void extend(unsigned thread) {
        S session(shared, in_slot(thread));
        session.begin(Mode::kAlone);
        forest::Step step = chain(30);
        step.edges.push_back({"base", "tool", 30});
        (void)store.apply(step, 3);
        session.end(true);
    }

    [[nodiscard]] StampNs newest(FrameId id) const { return edge(id).newest(); }
    [[nodiscard]] std::uint64_t samples(FrameId id) const { return edge(id).stored(); }
    /// After all threads: no lock is held, no slot is taken.
    void require_all_free() {
        require(shared.gate.gate().peek() == 0, "the gate is open");
        for (unsigned slot = 0; slot < SyncTuning<ForestMemory>::kSlots; ++slot)
            require(shared.gate.claimed(slot).peek() == 0, "the slots are free");
        for (const FrameId id : {kOdom, kBase})
            require((store.frames.word(id, history::kLock).peek() & kLockBits) == 0,
                    "the frames are free");
        require(store.word(graph::kCommitLock).peek() == 0, "the commit lock is free");
    }

    WalkedForest store{forest::Script{}};
    SharedState<ForestMemory> shared{store.frames, history::kForever, rule_of<S>()};

private:
    static constexpr StampNs kMoreThanFit = 32;

    [[nodiscard]] history::EdgeSegments<ForestMemory> edge(FrameId id) const {
        return {store.frames.memory(), store.frames.header(id)};
    }
    // Bits of a frame lock's word: the first two slots, waited for, exclusive. Bits of a version:
    // locked, waited for.
    static constexpr std::uint64_t kLockBits = 3 | std::uint64_t{3} << 62;

    template <class Stored>
    Written beside([[maybe_unused]] S& session,
                   [[maybe_unused]] const PlainBatch<ForestMemory>& batch,
                   [[maybe_unused]] CommitNumber& number, [[maybe_unused]] Stored stored) {
        if constexpr (S::kWritesBesideOthers)
            return write_beside(session, batch, store, number, stored);
        else
            return Written::kNotPlain;
    }
    static history::NewSample<ForestMemory> sample(FrameId parent, StampNs stamp) {
        history::NewSample<ForestMemory> made;
        made.stamp = stamp;
        made.parent = parent;
        made.payload = std::bit_cast<std::array<std::uint64_t, 7>>(
            forest::pose_of(static_cast<std::size_t>(stamp), parent));
        return made;
    }
    [[nodiscard]] bool newest_of(S& session, FrameId child, StampNs& stamp) {
        FrameId parent = kNoFrame;
        return lookup::detail::newest_stamp(session.view(), child, stamp, parent) ==
               lookup::Outcome::kOk;
    }
};

template <class S>
using Body = std::function<void(Stage<S>&, unsigned thread)>;
template <class S>
using MakeFlaw = std::function<std::unique_ptr<sched::Interceptor>(Stage<S>&)>;

/// One thread per body; `flaw` intercepts all threads' accesses to its words.
template <class S>
sched::Program acted(const std::vector<Body<S>>& bodies,
                     const std::function<void(Stage<S>&)>& at_the_end,
                     const MakeFlaw<S>& make_flaw = {}) {
    return [=](sched::Run& run) {
        Stage<S> stage;
        const auto flaw = make_flaw ? make_flaw(stage) : nullptr;
        for (unsigned thread = 0; thread < bodies.size(); ++thread) {
            run.thread("thread" + std::to_string(thread),
                       [&, thread] { bodies[thread](stage, thread); });
        }
        run.join();
        at_the_end(stage);
    };
}

template <class S>
Body<S> reader(bool downward = false) {
    return [=](Stage<S>& stage, unsigned thread) { stage.read(thread, downward); };
}
template <class S>
Body<S> writer(StampNs stamp, std::vector<FrameId> frames = {kOdom, kBase}) {
    return [=](Stage<S>& stage, unsigned thread) { (void)stage.write(thread, stamp, frames); };
}
template <class S>
Body<S> incrementer(FrameId child) {
    return [=](Stage<S>& stage, unsigned thread) { stage.increment(thread, child); };
}
template <class S>
Body<S> extender() {
    return [](Stage<S>& stage, unsigned thread) { stage.extend(thread); };
}

template <class S>
std::function<void(Stage<S>&)> newest_is(StampNs odom, StampNs base, std::uint64_t count) {
    return [=](Stage<S>& stage) {
        stage.require_all_free();
        require(stage.newest(kOdom) == odom && stage.newest(kBase) == base, "the newest stamps");
        require(stage.samples(kOdom) + stage.samples(kBase) == count, "no sample was lost");
    };
}

inline sched::Walk bounded(unsigned preemptions) {
    sched::Options options;
    options.preemptions = preemptions;
    return sched::Walk(options);
}

/// The cases for every isolating engine. `upgrades` has the most steps.
template <class S>
void must_stand(const std::vector<FrameId>& other_order, sched::Walk upgrades = sched::Walk()) {
    sched::Walk walk;
    sched::Walk three = bounded(1);
    walk.must_hold("a reader beside a writer",
                   acted<S>({reader<S>(), writer<S>(20)}, newest_is<S>(20, 20, 6)));
    walk.must_hold("a reader downward",
                   acted<S>({reader<S>(true), writer<S>(20)}, newest_is<S>(20, 20, 6)));
    walk.must_hold("two writers",
                   acted<S>({writer<S>(20), writer<S>(21, other_order)}, newest_is<S>(21, 21, 8)));
    upgrades.must_hold(
        "two who read, then write the same",
        acted<S>({incrementer<S>(kOdom), incrementer<S>(kOdom)}, newest_is<S>(13, 11, 6)));
    three.must_hold(
        "two readers beside a writer",
        acted<S>({reader<S>(), reader<S>(true), writer<S>(20)}, newest_is<S>(20, 20, 6)));
    three.must_hold("a reader beside two writers",
                    acted<S>({reader<S>(), writer<S>(20), writer<S>(21, other_order)},
                             newest_is<S>(21, 21, 8)));
    walk.must_hold("a reader beside one who is alone",
                   acted<S>({reader<S>(), extender<S>()}, newest_is<S>(30, 30, 6)));
    walk.must_hold("a writer beside one who is alone",
                   acted<S>({writer<S>(20), extender<S>()}, newest_is<S>(30, 30, 8)));
}

// One thread only pretends to take some locks. Create one per execution.
class Pretends : public sched::Interceptor {
public:
    Pretends(std::size_t thread, sched::Which which) : thread_(thread), which_(std::move(which)) {}

    sched::Effect access(sched::Word& word, const sched::Operation& operation) override {
        const bool ours = which_(word) && sched::Run::inside_thread()->current() == thread_;
        if (ours && operation.kind == sched::Kind::kCompareExchange)
            return {operation.expected, operation.operand, true};
        return word.access_directly(operation);
    }

private:
    std::size_t thread_;
    sched::Which which_;
};

// `lie` changes the loads of some words. Create one per execution.
class Lies : public sched::Interceptor {
public:
    using Lie = std::function<std::uint64_t(std::uint64_t)>;
    Lies(sched::Which which, Lie lie) : which_(std::move(which)), lie_(std::move(lie)) {}

    sched::Effect access(sched::Word& word, const sched::Operation& operation) override {
        sched::Effect effect = word.access_directly(operation);
        if (which_(word) && sched::is_load(operation.kind))
            effect.before = lie_(effect.before);
        return effect;
    }

private:
    sched::Which which_;
    Lie lie_;
};

/// The lock word of one frame, or of both.
template <class S>
sched::Which lock_of(Stage<S>& stage, FrameId id) {
    return [word = &stage.store.frames.word(id, history::kLock)](const sched::Word& at) {
        return &at == word;
    };
}

template <class S>
sched::Which locks_of(Stage<S>& stage) {
    return [odom = lock_of(stage, kOdom), base = lock_of(stage, kBase)](const sched::Word& at) {
        return odom(at) || base(at);
    };
}

/// The flaw intercepts the threads' accesses to the region.
template <class S, class Make>
MakeFlaw<S> in_region(Make make) {
    return [=](Stage<S>& stage) -> std::unique_ptr<sched::Interceptor> {
        auto flaw = make(stage);
        stage.store.memory.intercept(flaw.get());
        return flaw;
    };
}

}  // namespace txn::engines

}  // namespace tfdb
