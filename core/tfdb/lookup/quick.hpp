// The common case of a lookup, in one pass over the path: ordered samples, one parent per frame,
// at most a few samples newer than the snapshot. Whatever is different is left to the general code.
#pragma once

#include <bit>
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

/// A view whose frames may be read in place.
template <class V>
concept InPlaceView = View<V> && requires(const V v) {
    v.frames();
    v.history();
};

/// A view that must be told before a frame is read, and again afterwards: its engine takes a lock
/// or notes a version. `enter` may refuse; its frame is then not read.
template <class V>
concept GuardedView = requires(const V v, FrameId id) {
    { v.enter(id) } -> std::same_as<bool>;
    v.leave(id);
};

/// Walks both frames up by the depth hints and mixes and composes each edge on the way.
/// Threads: any; each makes its own.
/// Guarantee: wait-free; what it answers is what the general code would answer, or it declines.
template <InPlaceView V>
class QuickLookup {
public:
    QuickLookup(const V& view, const Policy& policy, Answer& answer)
        : memory_(view.frames().memory()),
          view_(view),
          policy_(policy),
          answer_(answer),
          commit_(view.commit()) {}

    /// False: not the common case. The answer's edges are then unspecified.
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
        // Wrong depth hints led past the meeting point: both took the edge above it.
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

    /// The latest common time of two different frames; false: not the common case.
    [[nodiscard]] bool common_time(FrameId target, FrameId source, StampNs& stamp) {
        Node up;
        Node down;
        if (target == source || !start(source, up) || !start(target, down)) {
            return false;
        }
        stamp = history::kNoStamp;
        expect_changes();
        FrameId up_from = kNoFrame;
        FrameId down_from = kNoFrame;
        while (up.id != down.id) {
            const bool move_up =
                history::Topology::depth(up.topology) >= history::Topology::depth(down.topology);
            fetch(down.id, up.id);
            Node& node = move_up ? up : down;
            (move_up ? up_from : down_from) = node.id;
            Ring ring;
            const Entered entered(*this, node);
            if (!entered.admitted() || !open(node, ring)) {
                return false;
            }
            const StampNs newest =
                ring.is_static ? history::kNoStamp : stamp_at(ring, ring.head - 1);
            const std::uint64_t slot = slot_word(ring, ring.head - 1);
            if (!confirm(node, ring, ring.head - 1) || !ascend(node, slot)) {
                return false;
            }
            if (newest >= 0 && (stamp < 0 || newest < stamp)) {
                stamp = newest;
            }
        }
        if (stamp < 0) {
            stamp = 0;
        }
        return up_from != down_from || up_from == kNoFrame;
    }

private:
    using Memory = typename V::Memory;
    using Word = typename Memory::Word;
    using Layout = history::RingLayout<Memory>;
    using Topology = history::Topology;

    /// Where nothing was committed since this answer's last lookup, the caches still have its
    /// lines.
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

    /// What makes a frame none of the common case.
    static constexpr std::uint64_t kUnusual = Topology::kMixedParents | Topology::kUnordered |
                                              Topology::kCleared | Topology::kMortal |
                                              Topology::kRebuilt;
    static constexpr int kNear = 8;  // samples around the guess that are tried one by one

    struct Node {
        FrameId id = kNoFrame;
        const Word* header = nullptr;
        std::uint64_t topology = 0;
        std::uint32_t generation = 0;
    };
    struct Ring {
        std::uint64_t word = 0;
        std::uint64_t head = 0;
        std::uint64_t begin = 0;
        std::uint64_t mask = 0;
        const Word* stamps = nullptr;
        const Word* slots = nullptr;
        bool is_static = false;
    };

    /// One frame's stay behind its engine's guard, if it has one.
    /// Threads: one. Guarantee: as the view's `enter`.
    class Entered {
    public:
        [[gnu::always_inline]] Entered(const QuickLookup& lookup, Node& node)
            : view_(lookup.view_), id_(node.id) {
            if constexpr (GuardedView<V>) {
                entered_ = view_.enter(id_);
                // What was read of the frame before may be of another state.
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

    // Always inlined: each file that uses the class has a copy of `at`, and the linker keeps any
    // one.

    /// The frame must have been there when `written` was; its words are then taken along.
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
        // Equal, but known before the slot is there.
        const FrameId hinted = Topology::parent(node.topology);
        return parent == hinted && load(hinted, history::SlotWord::commit(slot), node);
    }

    /// If nothing in the ring is newer than the view, all of it is the view's, and the flags that
    /// were read before belong to it.
    [[nodiscard, gnu::always_inline]] bool open(const Node& node, Ring& ring) const {
        const Word* header = node.header;
        ring.word = header[history::kRing].load_acquire();
        ring.head = header[history::kHead].load_acquire();
        ring.begin = header[history::kBegin].load_acquire();
        ring.is_static = (node.topology & Topology::kStatic) != 0;
        if ((node.topology & kUnusual) != 0 || history::RingWord::empty(ring.word) ||
            ring.head <= ring.begin) {
            return false;
        }
        ring.mask = history::RingWord::capacity(ring.word) - 1;
        ring.stamps = &memory_.word(Layout::stamps(ring.word));
        ring.slots = &memory_.word(Layout::slots(ring.word));
        return header[history::kHeadCommit].load_relaxed() <= commit_ ||
               leave_out_newer(node, ring);
    }
    /// Few commits pass during one lookup: what they appended is left out one by one. The flags
    /// must be those of the ring that is read: one that was sorted anew has newer samples in its
    /// midst.
    [[nodiscard, gnu::noinline]] bool leave_out_newer(const Node& node, Ring& ring) const {
        if ((node.header[history::kTopology].load_acquire() & kUnusual) != 0)
            return false;
        for (int tries = kNear; ring.head > ring.begin && tries > 0; --tries) {
            if (history::SlotWord::commit(slot_word(ring, ring.head - 1)) <= commit_)
                return true;
            --ring.head;
        }
        return false;
    }
    [[nodiscard, gnu::always_inline]] bool confirm(const Node& node, const Ring& ring,
                                                   std::uint64_t lowest) const {
        Memory::fence_acquire();
        return node.header[history::kRing].load_relaxed() == ring.word &&
               node.header[history::kBegin].load_relaxed() <= lowest;
    }
    [[nodiscard]] static StampNs stamp_at(const Ring& ring, std::uint64_t index) {
        return history::as_stamp(ring.stamps[index & ring.mask].load_relaxed());
    }
    [[nodiscard]] static const Word* slot_at(const Ring& ring, std::uint64_t index) {
        return ring.slots + (1 + Memory::kPayloadWords) * (index & ring.mask);
    }
    [[nodiscard]] static std::uint64_t slot_word(const Ring& ring, std::uint64_t index) {
        return slot_at(ring, index)->load_relaxed();
    }
    /// Number by number: a copy of several words would wait until each of them has been stored.
    [[gnu::always_inline]] static geometry::Pose pose_in(const Word* slot) {
        const auto number = [slot](int i) {
            return std::bit_cast<double>(slot[1 + i].load_relaxed());
        };
        return {{number(0), number(1), number(2)}, {number(3), number(4), number(5), number(6)}};
    }
    /// Not inlined: mixing and composing together do not fit into the registers.
    [[gnu::noinline]] static void mix_slots(const Word* before, const Word* after, double share,
                                            geometry::Pose& pose) {
        geometry::assign(pose, geometry::interpolate(pose_in(before), pose_in(after), share));
    }

    /// Index of the sample at or before the stamp; false where the general code must look. Samples
    /// mostly come at a steady rate: the guess is at most a few positions off.
    [[nodiscard, gnu::always_inline]] bool find(const Node& node, const Ring& ring,
                                                std::uint64_t& index, StampNs& before) const {
        index = ring.head - 1;
        before = stamp_at(ring, index);
        if (stamp_ >= before) {
            return stamp_ == before;
        }
        const StampNs cutoff = before - view_.history();
        const double back = static_cast<double>(before - stamp_) *
                            std::bit_cast<double>(node.header[history::kRate].load_relaxed());
        if (back < static_cast<double>(index - ring.begin)) {
            index -= static_cast<std::uint64_t>(back);
        }
        before = stamp_at(ring, index);
        int tries = kNear;
        while (before > stamp_ && index > ring.begin && --tries > 0) {
            before = stamp_at(ring, --index);
        }
        while (tries > 0 && index + 1 < ring.head) {
            const StampNs after = stamp_at(ring, index + 1);
            if (after > stamp_) {
                break;
            }
            before = after;
            ++index;
            --tries;
        }
        if (tries <= 0 && !search(node, ring, index, before)) {
            return false;
        }
        return before <= stamp_ && before >= cutoff;
    }

    [[nodiscard]] bool search(const Node& node, const Ring& ring, std::uint64_t& index,
                              StampNs& before) const {
        typename V::Edge edge;
        if (!view_.open(node.id, edge) || !edge.ordered()) {
            return false;
        }
        index = edge.upper_bound(stamp_);
        if (index <= edge.lo() || index <= ring.begin || index >= ring.head) {
            return false;
        }
        before = stamp_at(ring, --index);
        return true;
    }

    static void put_in_front(const geometry::Pose& pose, geometry::Pose& composed, bool& moved) {
        if (moved) {
            geometry::assign(composed, geometry::compose(pose, composed));
        } else {
            geometry::assign(composed, pose);
        }
        moved = true;
    }

    /// Takes one edge: its pose at the stamp goes in front of what was composed so far.
    [[nodiscard, gnu::always_inline]] bool step(Node& node, geometry::Pose& composed, bool& moved,
                                                std::vector<EdgeUse>& uses, bool inverted) {
        Ring ring;
        const Entered entered(*this, node);
        if (!entered.admitted() || !open(node, ring)) {
            return false;
        }
        const FrameId child = node.id;
        const std::uint32_t generation = node.generation;
        std::uint64_t index = ring.head - 1;
        StampNs before = history::kNoStamp;
        StampNs after = history::kNoStamp;
        Used used = ring.is_static ? Used::kStatic : Used::kExact;
        const Word* next = nullptr;
        if (!ring.is_static && policy_.kind == PolicyKind::kLatest) {
            used = Used::kLatest;
            before = after = stamp_at(ring, index);
        } else if (!ring.is_static) {
            if (!find(node, ring, index, before)) {
                return false;
            }
            after = before;
            if (before != stamp_) {
                used = Used::kInterpolated;
                after = stamp_at(ring, index + 1);
                next = slot_at(ring, index + 1);
            }
            if (after - before > policy_.limit) {
                return false;
            }
        }
        const Word* slot = slot_at(ring, index);
        const std::uint64_t first = slot->load_relaxed();
        geometry::Pose pose;
        if (next != nullptr) {
            mix_slots(slot, next, geometry::share(before, after, stamp_), pose);
        } else {
            geometry::assign(pose, pose_in(slot));
        }
        // A pose from words that were overwritten meanwhile is turned down here.
        if (!confirm(node, ring, index) || !ascend(node, first)) {
            return false;
        }
        // Filled in place: a use built elsewhere and copied as a block would stall.
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
    StampNs stamp_ = 0;
    unsigned unfetched_in_ = ~0U;  // steps that the lines already asked for will do
    std::vector<EdgeUse>& down_uses_ = answer_.target_edges;
};

/// Policies of which the quick code knows the common case.
[[nodiscard]] inline bool quick_policy(const Policy& policy) {
    return policy.kind == PolicyKind::kInterpolate || policy.kind == PolicyKind::kLatest;
}

}  // namespace tfdb::lookup
