// The common case of a lookup, in one pass over the path: one parent per frame, both samples in one
// segment, at most a few samples newer than the snapshot. The general code handles all other cases.
#pragma once

#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <optional>

#include "tfdb/geometry/slerp.hpp"
#include "tfdb/lookup/answer.hpp"
#include "tfdb/lookup/edge.hpp"
#include "tfdb/lookup/fetch.hpp"
#include "tfdb/lookup/policy.hpp"
#include "tfdb/lookup/view.hpp"

namespace tfdb::lookup {

/// A view whose frames can be read in place.
template <class V>
concept InPlaceView = View<V> && requires(const V v) {
    v.frames();
    v.history();
    { v.as_of() } -> std::same_as<history::AsOf>;  // loaded before any read
};

/// A view that brackets each frame's reads with `enter` and a call afterwards: its engine takes a
/// lock or records a version. If `enter` refuses, the frame is not read.
template <class V>
concept GuardedView = requires(const V v, FrameId id) {
    { v.enter(id) } -> std::same_as<bool>;
    v.leave(id);
};

/// Walks both frames up by the depth hints, and interpolates and composes each edge on the way.
/// Threads: any; each creates its own.
/// Guarantee: wait-free; its answers equal those of the general code, or it declines.
template <InPlaceView V>
class QuickLookup {
public:
    QuickLookup(const V& view, const Policy& policy, Answer& answer)
        : memory_(view.frames().memory()),
          view_(view),
          // copying the whole policy would wait for both stores
          policy_{policy.kind, policy.limit},
          answer_(answer),
          commit_(view.commit()),
          as_of_(view.as_of()) {}

    /// False: not the common case; the answer's edges are then unspecified.
    [[nodiscard]] bool at(FrameId target, FrameId source, StampNs stamp) {
        stamp_ = stamp;
        answer_.edges.clear();
        down_uses_.clear();
        expect_changes();
        Node up;
        Node down;
        if (!start(source, up) || !start(target, down)) {
            return false;
        }
        geometry::Pose from_source = geometry::identity();
        geometry::Pose from_target = geometry::identity();
        bool source_moved = false;
        bool target_moved = false;
        while (up.id != down.id) {
            fetch(down.id, up.id);
            const bool move_up =
                history::Topology::depth(up.topology) >= history::Topology::depth(down.topology);
            const bool stepped = move_up ? step(up, from_source, source_moved, answer_.edges, false)
                                         : step(down, from_target, target_moved, down_uses_, true);
            if (!stepped) {
                return false;
            }
        }
        // Wrong depth hints led past the meeting point: both sides took the edge above it.
        if (source_moved && target_moved && answer_.edges.back().child == down_uses_.back().child) {
            return false;
        }
        if (!target_moved) {
            geometry::assign(answer_.pose, from_source);
        } else {
            answer_.edges.insert(answer_.edges.end(), down_uses_.begin(), down_uses_.end());
            answer_.pose = geometry::inverse(from_target);
            if (source_moved) {
                answer_.pose = geometry::compose(answer_.pose, from_source);
            }
        }
        answer_.stamp = stamp;
        answer_.commit = commit_;
        return geometry::is_finite(answer_.pose);
    }

    /// The edge from a frame to its parent at a stamp; false: not the common case.
    [[nodiscard]] bool edge(FrameId child, StampNs stamp) {
        stamp_ = stamp;
        answer_.edges.clear();
        Node node;
        bool moved = false;
        if (!start(child, node) || !step(node, answer_.pose, moved, answer_.edges, false)) {
            return false;
        }
        answer_.stamp = stamp;
        answer_.commit = commit_;
        return geometry::is_finite(answer_.pose);
    }

    /// The latest common time of two different frames; false: not the common case.
    [[nodiscard]] bool common_time(FrameId target, FrameId source, StampNs& stamp) {
        stamp = history::kNoStamp;
        const bool met = meet(target, source, [&](const Node&, Samples& tail) {
            const StampNs newest = tail.stamp(tail.end - 1);
            if (newest >= 0 && (stamp < 0 || newest < stamp)) {
                stamp = newest;
            }
            return tail.slot(tail.end - 1);
        });
        if (stamp < 0) {
            stamp = 0;
        }
        return met;
    }

    /// Whether `at` answers for two different frames, without interpolation. False: not the common
    /// case.
    [[nodiscard]] bool covers(FrameId target, FrameId source, StampNs stamp) {
        stamp_ = stamp;
        return meet(target, source, [this](const Node& node, Samples& in) {
            StampNs before = history::kNoStamp;
            StampNs after = history::kNoStamp;
            Used used = Used::kExact;
            const Word* slot = nullptr;
            const Word* next = nullptr;
            const bool sound = choose(node, in, before, after, used, slot, next) && is_near(slot) &&
                               (next == nullptr || is_near(next));
            return sound ? slot : nullptr;
        });
    }

private:
    using Memory = typename V::Memory;
    using Word = typename Memory::Word;
    using Segment = history::Segment<Memory>;
    using SegmentWord = history::SegmentWord;
    using Topology = history::Topology;

    /// If nothing was committed since this answer's last lookup, the cache still holds its lines.
    void expect_changes() {
        if (answer_.commit != commit_) {
            answer_.commit = commit_;
            unfetched_in_ = 0;
        }
    }
    [[gnu::always_inline]] void fetch(FrameId target, FrameId source) {
        if constexpr (memory::Fetchable<Memory>) {
            if (unfetched_in_-- == 0)
                unfetched_in_ = fetch_path(view_.frames(), target, source);
        }
    }

    /// Flags that exclude a frame from the common case.
    static constexpr std::uint64_t kUnusual = Topology::kMixedParents | Topology::kMortal;
    // More than any path has: parents form a cycle only in a damaged store.
    static constexpr FrameId kMostSteps = kNoFrame;
    static constexpr int kNear = 8;  // samples around the guess that are tried one by one

    struct Node {
        FrameId id = kNoFrame;
        const Word* header = nullptr;
        std::uint64_t topology = 0;
        std::uint32_t generation = 0;
    };
    /// The samples of one segment at [begin, end), in place.
    struct Samples {
        std::uint64_t begin = 0;
        std::uint64_t end = 0;
        const Word* stamps = nullptr;
        const Word* slots = nullptr;

        [[nodiscard, gnu::always_inline]] StampNs stamp(std::uint64_t index) const {
            return history::as_stamp(stamps[index].load_relaxed());
        }
        [[nodiscard, gnu::always_inline]] const Word* slot(std::uint64_t index) const {
            return slots + (1 + Memory::kPayloadWords) * index;
        }
        [[nodiscard, gnu::always_inline]] CommitNumber commit(std::uint64_t index) const {
            return history::SlotWord::commit(slot(index)->load_relaxed());
        }
    };

    /// One frame's read inside its engine's guard, if it has one.
    /// Threads: one. Guarantee: as the view's `enter`.
    class Entered {
    public:
        [[gnu::always_inline]] Entered(const QuickLookup& lookup, Node& node)
            : view_(lookup.view_), id_(node.id) {
            if constexpr (GuardedView<V>) {
                entered_ = view_.enter(id_);
                // Words read before the guard may belong to another state.
                admitted_ = entered_ && lookup.load(id_, lookup.commit_, node);
            }
        }
        [[gnu::always_inline]] ~Entered() {
            if constexpr (GuardedView<V>) {
                if (entered_)
                    view_.leave(id_);
            }
        }
        Entered(const Entered&) = delete;
        Entered& operator=(const Entered&) = delete;
        [[nodiscard]] bool admitted() const { return admitted_; }

    private:
        const V& view_;
        FrameId id_;
        bool entered_ = false;
        bool admitted_ = true;
    };

    /// Walks two different frames up until they meet. `look(node, samples)` returns, for each edge,
    /// the sample that names the parent; null: not the common case.
    template <class Look>
    [[nodiscard, gnu::always_inline]] bool meet(FrameId target, FrameId source, Look look) {
        Node up;
        Node down;
        if (target == source || !start(source, up) || !start(target, down)) {
            return false;
        }
        expect_changes();
        FrameId up_from = kNoFrame;
        FrameId down_from = kNoFrame;
        for (FrameId steps = 0; up.id != down.id; ++steps) {
            const bool move_up =
                history::Topology::depth(up.topology) >= history::Topology::depth(down.topology);
            fetch(down.id, up.id);
            if (steps == kMostSteps)
                return false;
            Node& node = move_up ? up : down;
            (move_up ? up_from : down_from) = node.id;
            Samples in;
            const Entered entered(*this, node);
            if (!entered.admitted() || !open(node, in)) {
                return false;
            }
            const Word* const slot = look(node, in);
            if (slot == nullptr) {
                return false;
            }
            const std::uint64_t first = slot->load_relaxed();
            if (!confirm() || !ascend(node, first)) {
                return false;
            }
        }
        // Wrong depth hints led past the meeting point: both sides took the edge above it.
        return up_from != down_from || up_from == kNoFrame;
    }

    // Always inlined: each file that uses the class has its own copy of `at`, and the linker keeps
    // any one of them.

    /// The frame must have existed when `written` was written; loads the frame's words.
    [[nodiscard, gnu::always_inline]] bool load(FrameId id, CommitNumber written,
                                                Node& node) const {
        node.id = id;
        node.header = &memory_.word(view_.frames().header(id));
        const std::uint64_t born = node.header[history::kBorn].load_acquire();
        node.topology = node.header[history::kTopology].load_acquire();
        node.generation = static_cast<std::uint32_t>(born & kNoFrame);
        return born >> kFrameBits <= written && (node.topology & Topology::kMortal) == 0;
    }
    [[nodiscard, gnu::always_inline]] bool start(FrameId id, Node& node) const {
        return id != kNoFrame && load(id, commit_, node);
    }
    [[nodiscard, gnu::always_inline]] bool ascend(Node& node, std::uint64_t slot) const {
        const FrameId parent = history::SlotWord::parent(slot);
        // Equal, but available before the slot is loaded.
        const FrameId hinted = Topology::parent(node.topology);
        return parent == hinted && load(hinted, history::SlotWord::commit(slot), node);
    }

    [[nodiscard, gnu::always_inline]] Samples samples(std::uint64_t word) const {
        const Segment segment(memory_, word);
        return {segment.begin(), segment.end(), &memory_.word(segment.stamp_offset(0)),
                &memory_.word(segment.slot(0))};
    }
    /// Opens the tail up to its last sample visible to the view.
    [[nodiscard, gnu::always_inline]] bool open(const Node& node, Samples& tail) const {
        const Word* header = node.header;
        const std::uint64_t word = header[history::kTail].load_acquire();
        if ((node.topology & kUnusual) != 0 || SegmentWord::count(word) == 0 ||
            header[history::kSince].load_acquire() > commit_) {
            return false;
        }
        tail = samples(word);
        if (header[history::kChanged].load_relaxed() > commit_) {
            tail.end = leave_out_newer(header, tail);
        }
        return tail.end != tail.begin;
    }
    /// Few commits pass during one lookup, so their samples are skipped one by one. The flags must
    /// belong to the samples that are read. Returns the tail's end, or its begin if no sample is
    /// left.
    [[nodiscard, gnu::noinline]] std::uint64_t leave_out_newer(const Word* header,
                                                               Samples tail) const {
        if ((header[history::kTopology].load_acquire() & kUnusual) != 0 ||
            header[history::kCorrected].load_relaxed() > commit_)
            return tail.begin;
        for (int tries = kNear; tail.end > tail.begin && tries > 0; --tries) {
            if (tail.commit(tail.end - 1) <= commit_)
                return tail.end;
            --tail.end;
        }
        return tail.begin;
    }
    [[nodiscard, gnu::always_inline]] bool confirm() const {
        Memory::fence_acquire();
        return memory_.reclaimed(memory::Line::kReplaced).load_relaxed() <= as_of_.epoch &&
               memory_.reclaimed(memory::Line::kEnded).load_relaxed() <= as_of_.commit;
    }
    /// Word by word: a copy of several words would wait until each of them has been stored.
    [[gnu::always_inline]] static geometry::Pose pose_in(const Word* slot) {
        const auto number = [slot](int i) {
            return std::bit_cast<double>(slot[1 + i].load_relaxed());
        };
        return {{number(0), number(1), number(2)}, {number(3), number(4), number(5), number(6)}};
    }
    /// Whether the pose is so small that composition along any path cannot overflow.
    [[nodiscard, gnu::always_inline]] static bool is_near(const Word* slot) {
        constexpr double kFar = 1e290;
        bool near = true;
        for (int i = 1; i <= 3; ++i)
            near &= std::abs(std::bit_cast<double>(slot[i].load_relaxed())) < kFar;
        return near;
    }
    /// Not inlined: interpolation and composition together exceed the registers.
    [[gnu::noinline]] static void mix_slots(const Word* before, const Word* after, double share,
                                            geometry::Pose& pose) {
        geometry::assign(pose, geometry::interpolate(pose_in(before), pose_in(after), share));
    }

    /// Index of the sample at or before the stamp; false: the general code must search. Samples
    /// mostly arrive at a steady rate, so the guess is at most a few positions off.
    [[nodiscard, gnu::always_inline]] bool find(const Node& node, Samples& in, std::uint64_t& index,
                                                StampNs& before) const {
        index = in.end - 1;
        before = in.stamp(index);
        if (stamp_ >= before) {
            return stamp_ == before;
        }
        const StampNs cutoff = before - view_.history();
        const double back = static_cast<double>(before - stamp_) *
                            std::bit_cast<double>(node.header[history::kRate].load_relaxed());
        // Negative only in a damaged store.
        if (back >= 0.0 && back < static_cast<double>(index - in.begin)) {
            index -= static_cast<std::uint64_t>(back);
        } else if (in.stamp(in.begin) > stamp_) {
            const Place sealed = find_sealed(node.header, in.stamp(in.begin));
            in = sealed.in;
            index = sealed.index;
            before = sealed.before;
            return sealed.found && before >= cutoff;
        }
        return near(in, index, before) && before >= cutoff;
    }
    /// Moves from a guess to the sample at or before the stamp. The general code must search if the
    /// next sample's stamp occurs several times or lies in another segment.
    [[nodiscard, gnu::always_inline]] bool near(const Samples& in, std::uint64_t& index,
                                                StampNs& before) const {
        before = in.stamp(index);
        int tries = kNear;
        while (before > stamp_ && index > in.begin && --tries > 0) {
            before = in.stamp(--index);
        }
        StampNs after = before;
        while (tries > 0 && index + 1 < in.end) {
            after = in.stamp(index + 1);
            if (after > stamp_) {
                break;
            }
            before = after;
            ++index;
            --tries;
        }
        if (tries <= 0) {
            index = search(in);
            if (index == in.begin)
                return false;
            before = in.stamp(--index);
            if (index + 1 < in.end)
                after = in.stamp(index + 1);
        }
        if (before > stamp_) {
            return false;
        }
        const bool repeated = index + 2 < in.end && in.stamp(index + 2) == after;
        return before == stamp_ || (index + 1 < in.end && !repeated);
    }
    [[nodiscard, gnu::noinline]] std::uint64_t search(Samples in) const {
        return history::halve([&](std::uint64_t i) { return in.stamp(i); }, in.begin, in.end,
                              stamp_);
    }
    /// A sample at or before the stamp, if found.
    struct Place {
        bool found = false;
        Samples in;
        std::uint64_t index = 0;
        StampNs before = history::kNoStamp;
    };
    /// For a stamp before the tail, which begins at `tail`: the sample lies in a segment of the
    /// directory, and not at the segment's ends.
    [[nodiscard, gnu::noinline]] Place find_sealed(const Word* header, StampNs tail) const {
        const Offset block = header[history::kDirectory].load_acquire();
        if (block == 0) {
            return {};
        }
        const history::Directory<Memory> directory(memory_, block);
        const std::uint64_t end = directory.end();
        const std::uint64_t begin = directory.begin(end);
        // Words of a reused block may point anywhere.
        if (begin >= end || !confirm()) {
            return {};
        }
        const std::uint64_t k = directory.find(begin, end, stamp_);
        const std::uint64_t word = directory.entry(k).load_acquire();
        const StampNs first = directory.first(k);
        const StampNs next = k + 1 < end ? directory.first(k + 1) : tail;
        if (SegmentWord::count(word) == 0 || !confirm()) {
            return {};
        }
        Place place{.in = samples(word)};
        const Samples& in = place.in;
        const double share =
            static_cast<double>(stamp_ - first) / static_cast<double>(next - first);
        const auto count = static_cast<double>(in.end - in.begin);
        place.index = in.begin;
        if (share > 0.0 && share < 1.0)
            place.index += static_cast<std::uint64_t>(share * count);
        // The view's header words belong to an older version of the edge.
        if (header[history::kSince].load_acquire() > commit_) {
            return {};
        }
        // The last sample may be followed by others with its stamp, in the next segment.
        place.found = near(in, place.index, place.before) &&
                      place.index + (place.before == stamp_ ? 1 : 2) < in.end;
        return place;
    }

    static void put_in_front(const geometry::Pose& pose, geometry::Pose& composed, bool& moved) {
        if (moved) {
            geometry::assign(composed, geometry::compose(pose, composed));
        } else {
            geometry::assign(composed, pose);
        }
        moved = true;
    }

    /// The sample that answers, and the next one if they are interpolated.
    [[nodiscard, gnu::always_inline]] bool choose(const Node& node, Samples& in, StampNs& before,
                                                  StampNs& after, Used& used, const Word*& slot,
                                                  const Word*& next) const {
        std::uint64_t index = in.end - 1;
        before = in.stamp(index);
        if (before == history::kStaticStamp) {
            used = Used::kStatic;
            before = history::kNoStamp;
        } else if (policy_.kind == PolicyKind::kLatest) {
            used = Used::kLatest;
            after = before;
        } else {
            if (!find(node, in, index, before)) {
                return false;
            }
            after = before;
            if (before != stamp_) {
                used = Used::kInterpolated;
                after = in.stamp(index + 1);
                next = in.slot(index + 1);
            }
            if (after - before > policy_.limit) {
                return false;
            }
        }
        slot = in.slot(index);
        // Excludes a late sample of a commit after the view.
        return history::SlotWord::commit(slot->load_relaxed()) <= commit_ &&
               (next == nullptr || history::SlotWord::commit(next->load_relaxed()) <= commit_);
    }

    /// Steps over one edge: composes its pose at the stamp in front of the result so far.
    [[nodiscard, gnu::always_inline]] bool step(Node& node, geometry::Pose& composed, bool& moved,
                                                std::vector<EdgeUse>& uses, bool inverted) {
        Samples in;
        const Entered entered(*this, node);
        if (!entered.admitted() || !open(node, in)) {
            return false;
        }
        const FrameId child = node.id;
        const std::uint32_t generation = node.generation;
        StampNs before = history::kNoStamp;
        StampNs after = history::kNoStamp;
        Used used = Used::kExact;
        const Word* slot = nullptr;
        const Word* next = nullptr;
        if (!choose(node, in, before, after, used, slot, next)) {
            return false;
        }
        const std::uint64_t first = slot->load_relaxed();
        geometry::Pose pose;
        if (next != nullptr) {
            mix_slots(slot, next, geometry::share(before, after, stamp_), pose);
        } else {
            geometry::assign(pose, pose_in(slot));
        }
        // Rejects a pose whose words were overwritten meanwhile.
        if (!confirm() || !ascend(node, first)) {
            return false;
        }
        if (uses.size() == kMostSteps) [[unlikely]]
            return false;
        // Filled in place: an EdgeUse built elsewhere and block-copied would stall.
        EdgeUse& use = uses.emplace_back();
        use.child = child;
        use.parent = node.id;
        use.generation = generation;
        use.parent_generation = node.generation;
        use.before = before;
        use.after = after;
        use.used = used;
        use.inverted = inverted;
        put_in_front(pose, composed, moved);
        return true;
    }

    Memory& memory_;
    const V& view_;
    Policy policy_;
    Answer& answer_;
    CommitNumber commit_;
    history::AsOf as_of_;
    StampNs stamp_ = 0;
    unsigned unfetched_in_ = ~0U;  // steps until more lines are prefetched
    std::vector<EdgeUse>& down_uses_ = answer_.target_edges;
};

/// Policies whose common case the quick code answers.
[[nodiscard]] inline bool quick_policy(const Policy& policy) {
    return policy.kind == PolicyKind::kInterpolate || policy.kind == PolicyKind::kLatest;
}

}  // namespace tfdb::lookup
