// Searches for cycles: no frame may be its own ancestor at any time.
//
// A sample names its edge's parent from its stamp to the edge's next sample (a static edge: for all
// time). A new sample closes a cycle if, somewhere in that interval, a walk upward from its child
// returns to its child. The walk splits the interval where a frame on the path changes its parent.
// It marks frames without a cycle above them, so that it visits them once.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

#include "tfdb/graph/frames.hpp"
#include "tfdb/txn/snapshot_view.hpp"

namespace tfdb::txn {

/// A cycle that a commit would close, and the commit's sample to exclude.
struct Cycle {
    FrameId child = kNoFrame;
    FrameId parent = kNoFrame;
    // as passed to `append`: the greatest of the items that close the cycle together
    std::size_t item = 0;
    // The commit's other samples of this edge that name this parent for [from, to) close it too.
    clock::StampNs from = 0;
    clock::StampNs to = 0;
};

/// The commit's samples that may add a parent-child relation, and the search's lists. The store
/// keeps them, so that no commit allocates in steady state.
struct CycleScratch {
    struct Relation {  // a sample whose parent may be new at its stamp
        FrameId child;
        FrameId parent;
        clock::StampNs stamp;
        std::size_t item;
    };
    struct Stop {  // a step of the search's walk
        FrameId id;
        clock::StampNs from;
        clock::StampNs to;
        bool entered;  // its ancestors are being searched
    };
    struct Mark {  // a frame in one search
        std::uint64_t search = 0;
        clock::StampNs from = 0;  // within [from, to) all its ancestors were searched
        clock::StampNs to = 0;
        bool on_path = false;
        bool blamed = false;  // a sample of its edge is to be excluded

        [[nodiscard]] bool covers(clock::StampNs a, clock::StampNs b) const {
            return from <= a && b <= to;
        }
        void leave(clock::StampNs a, clock::StampNs b) {
            on_path = false;
            const bool apart = from == to || b < from || to < a;
            from = apart || a < from ? a : from;
            to = apart || to < b ? b : to;
        }
    };
    std::vector<Relation> relations;
    std::vector<Stop> stops;
    std::vector<FrameId> path;            // the entered stops
    std::vector<Mark> marks;              // by frame
    std::vector<std::uint32_t> by_child;  // the relations, sorted
    std::uint64_t searches = 0;
    std::uint64_t steps = 0;  // stops, samples and relations that searches visited: for tests
};

/// Searches a commit's appended samples before they are published.
/// Threads: the holder of the commit lock. Guarantee: terminates on any cycle.
template <class Memory>
class CycleSearch {
public:
    CycleSearch(const graph::Frames<Memory>& frames, CommitNumber committed, clock::StampNs history,
                CycleScratch& scratch)
        : frames_(frames),
          before_(frames, committed, history),
          after_(frames, committed + 1, history),
          scratch_(scratch) {}

    /// Finds one cycle.
    [[nodiscard]] bool find(Cycle& cycle) {
        return find(cycle, [](FrameId) {});
    }
    /// Finds one cycle, and calls visit(id) for each of its frames.
    template <class Visit>
    [[nodiscard]] bool find(Cycle& cycle, Visit visit) {
        bool any = false;
        if (scratch_.relations.empty())
            return any;
        search([&](const Stop& top, const Cycle& suspect) {
            for_each_in_cycle(top.id, visit);
            cycle = last_relation(top, suspect);
            any = true;
            return Next::kEnd;
        });
        return any;
    }

    /// Finds cycles, but not always all: excluding their samples may reveal others.
    ///
    /// If two cycles share a frame that is to change, only one is reported: the change may remove
    /// both. Once the suspect is to change, no frame above it is searched: the latest relation is
    /// found first, so its end is the end of all.
    [[nodiscard]] bool find_all(std::vector<Cycle>& cycles) {
        cycles.clear();
        search([&](const Stop& top, const Cycle& suspect) {
            const Cycle cycle = last_relation(top, suspect);
            bool touches_another = false;
            for_each_in_cycle(top.id, [&](FrameId id) {
                touches_another |= id != cycle.child && mark_of(id).blamed;
            });
            if (touches_another)
                return Next::kGoOn;
            mark_of(cycle.child).blamed = true;
            cycles.push_back(cycle);
            return cycle.item == suspect.item ? Next::kSuspect : Next::kGoOn;
        });
        return !cycles.empty();
    }

    /// After a search: every relation that may be part of a cycle. Without them the batch has no
    /// cycle.
    void suspects(std::vector<Cycle>& cycles) const {
        cycles.clear();
        for (const auto& relation : scratch_.relations) {
            if ((frames_.topology(relation.child) & history::Topology::kParented) != 0) {
                cycles.push_back({relation.child, relation.parent, relation.item, kDawn, kDusk});
            }
        }
    }

private:
    using StampNs = clock::StampNs;
    using Relation = CycleScratch::Relation;
    using Stop = CycleScratch::Stop;
    using Mark = CycleScratch::Mark;
    static constexpr StampNs kDawn = std::numeric_limits<StampNs>::min();
    static constexpr StampNs kDusk = std::numeric_limits<StampNs>::max();
    enum class Next : std::uint8_t {
        kGoOn,     // continue above the same suspect
        kSuspect,  // continue with the other suspects
        kEnd,
    };

    /// Calls `found(top, suspect)` for each cycle that it finds, and continues as the result says.
    /// The path in scratch_.path then leads from the frame at `top` back to it.
    ///
    /// A cycle needs its child to be a parent already. Relations are processed in order of arrival,
    /// so in a chain built from its root no frame is a parent yet. The last relation that closes a
    /// cycle always finds the others in place.
    template <class Found>
    void search(Found found) {
        using history::Topology;
        ++scratch_.searches;
        scratch_.by_child.clear();
        Cycle last;  // the last one that was walked
        for (const auto& relation : scratch_.relations) {
            const bool seen = relation.child == last.child && relation.parent == last.parent &&
                              last.from <= relation.stamp && relation.stamp < last.to;
            Cycle next{relation.child, relation.parent, relation.item, 0, 0};
            if (!seen && (frames_.topology(relation.child) & Topology::kParented) != 0 &&
                holds(relation, next.from, next.to)) {
                last = next;
                if (walk(next, found) == Next::kEnd)
                    return;
            }
            auto& topology = frames_.word(relation.parent, history::kTopology);
            const std::uint64_t word = topology.load_relaxed();
            if ((word & Topology::kParented) == 0)
                topology.store_release(word | Topology::kParented);
        }
    }

    /// Walks up from a frame along all parents that it has in the interval.
    template <class Found>
    [[nodiscard]] Next walk(const Cycle& suspect, Found& found) {
        auto& stops = scratch_.stops;
        auto& path = scratch_.path;
        path.clear();
        stops.assign(1, {suspect.child, suspect.from, suspect.to, false});
        while (!stops.empty()) {
            ++scratch_.steps;
            const Stop at = stops.back();
            Mark& mark = mark_of(at.id);
            if (at.entered) {
                mark.leave(at.from, at.to);
                path.pop_back();
            } else if (mark.on_path) {
                const Next next = found(at, suspect);
                if (next == Next::kGoOn) {
                    stops.pop_back();
                    continue;
                }
                // The search above them is incomplete.
                for (const FrameId id : path)
                    mark_of(id).on_path = false;
                return next;
            } else if (!mark.covers(at.from, at.to)) {
                path.push_back(at.id);
                stops.back().entered = true;
                mark.on_path = true;
                push_parents(at);
                continue;
            }
            stops.pop_back();
        }
        return Next::kSuspect;
    }

    [[nodiscard]] Mark& mark_of(FrameId id) {
        if (id >= scratch_.marks.size()) {
            scratch_.marks.resize(std::max<std::size_t>(id + 1, 2 * scratch_.marks.size()));
        }
        Mark& mark = scratch_.marks[id];
        if (mark.search != scratch_.searches) {
            mark = {};
            mark.search = scratch_.searches;
        }
        return mark;
    }

    /// Visits the frames of the path from its end back to the repeated frame.
    template <class Visit>
    void for_each_in_cycle(FrameId top, Visit visit) const {
        for (auto at = scratch_.path.rbegin(); at != scratch_.path.rend(); ++at) {
            ++scratch_.steps;
            visit(*at);
            if (*at == top)
                return;
        }
    }

    /// The last relation among those that close the cycle together, and the interval of its parent.
    [[nodiscard]] Cycle last_relation(const Stop& top, const Cycle& suspect) {
        auto& order = scratch_.by_child;
        const auto& relations = scratch_.relations;
        if (order.size() != relations.size()) {
            order.resize(relations.size());
            for (std::size_t i = 0; i < order.size(); ++i)
                order[i] = static_cast<std::uint32_t>(i);
            std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
                return relations[a].child != relations[b].child
                           ? relations[a].child < relations[b].child
                           : relations[a].item < relations[b].item;
            });
        }
        Cycle cycle;
        for_each_in_cycle(top.id, [&](FrameId id) {
            auto found = std::upper_bound(
                order.begin(), order.end(), id,
                [&](FrameId of, std::uint32_t i) { return of < relations[i].child; });
            // The last one first.
            while (found != order.begin() && relations[*--found].child == id) {
                ++scratch_.steps;
                const auto& relation = relations[*found];
                if (cycle.child != kNoFrame && relation.item < cycle.item)
                    break;
                StampNs from = 0;
                StampNs to = 0;
                if (holds(relation, from, to) && from <= top.from && top.from < to &&
                    !held_before(relation, top.from)) {
                    cycle = {relation.child, relation.parent, relation.item, from, top.to};
                    break;
                }
            }
        });
        return cycle.child == kNoFrame ? suspect : cycle;
    }

    /// Whether the committed state already relates the two at that time: the relation is then not
    /// new.
    [[nodiscard]] bool held_before(const Relation& relation, StampNs stamp) const {
        history::EdgeView<Memory> edge;
        history::Bracket around;
        if (!before_.open(relation.child, edge) || edge.empty()) {
            return false;
        }
        if (edge.is_static()) {
            around.before = edge.newest();
        } else if (!edge.bracket(stamp, around) || !around.before) {
            return false;
        }
        const std::uint64_t slot = edge.slot_word(around.before);
        return history::SlotWord::parent(slot) == relation.parent &&
               before_.alive_since(relation.parent, history::SlotWord::commit(slot));
    }

    /// The interval in which the relation's parent holds. False if it never does: the sample is too
    /// old to be seen, or a later member of the same batch replaced it.
    [[nodiscard]] bool holds(const Relation& relation, StampNs& from, StampNs& to) const {
        const auto names_parent = [&](const history::EdgeView<Memory>& edge,
                                      const history::SampleAt& sample) {
            // Excludes an earlier frame whose slot the parent took over.
            const std::uint64_t slot = edge.slot_word(sample);
            return history::SlotWord::parent(slot) == relation.parent &&
                   after_.alive_since(relation.parent, history::SlotWord::commit(slot));
        };
        from = kDawn;
        to = kDusk;
        history::EdgeView<Memory> edge;
        history::Bracket around;
        if (!after_.open(relation.child, edge)) {
            return false;
        }
        if (relation.stamp < 0) {
            return names_parent(edge, edge.newest());
        }
        if (!edge.bracket(relation.stamp, around)) {
            return false;
        }
        if (!around.before) {
            // Too old by now, but the next sample may rely on it.
            if (!around.after || !edge.bracket(around.after.stamp, around))
                return false;
        } else if (around.before.stamp != relation.stamp) {
            return false;
        }
        if (!names_parent(edge, around.before)) {
            return false;
        }
        from = around.before.stamp;
        if ((edge.topology() & history::Topology::kMixedParents) == 0) {
            return true;
        }
        // Later samples that name the same parent are not visited separately.
        to = kDusk;
        return edge.visit(from + 1, kDusk, 0, [&](const history::SampleAt& sample) {
            ++scratch_.steps;
            if (sample.stamp <= from || names_parent(edge, sample))
                return true;
            to = sample.stamp;
            return false;
        });
    }

    void push_stop(FrameId parent, CommitNumber written, StampNs from, StampNs to) {
        if (parent != kNoFrame && from < to && after_.alive_since(parent, written)) {
            scratch_.stops.push_back({parent, from, to, false});
        }
    }

    void push_parents(const Stop& at) {
        history::EdgeView<Memory> edge;
        if (!after_.open(at.id, edge) || edge.empty())
            return;
        if (edge.is_static()) {
            const std::uint64_t slot = edge.slot_word(edge.newest());
            push_stop(history::SlotWord::parent(slot), history::SlotWord::commit(slot), at.from,
                      at.to);
            return;
        }
        if ((edge.topology() & history::Topology::kMixedParents) != 0) {
            push_mixed_parents(edge, at);
            return;
        }
        history::SampleAt oldest;
        if (!edge.oldest(oldest) || !oldest)
            return;
        const std::uint64_t slot = edge.slot_word(oldest);
        push_stop(history::SlotWord::parent(slot), history::SlotWord::commit(slot),
                  std::max(at.from, oldest.stamp), at.to);
    }

    /// Pushes the parents from the sample that holds at the interval's start to the last one in it.
    /// Consecutive samples that name the same parent count as one.
    void push_mixed_parents(const history::EdgeView<Memory>& edge, const Stop& at) {
        FrameId parent = kNoFrame;
        // newest commit of the row: its parent existed throughout, or never
        CommitNumber written = 0;
        StampNs from = at.from;
        const bool whole = edge.visit(at.from, at.to, 0, [&](const history::SampleAt& sample) {
            ++scratch_.steps;
            if (sample.stamp >= at.to)
                return false;
            const std::uint64_t slot = edge.slot_word(sample);
            const CommitNumber commit = history::SlotWord::commit(slot);
            const bool known = after_.alive_since(history::SlotWord::parent(slot), commit);
            const FrameId named = known ? history::SlotWord::parent(slot) : kNoFrame;
            if (named != parent) {
                push_stop(parent, written, std::max(at.from, from), std::min(at.to, sample.stamp));
                parent = named;
                from = sample.stamp;
            }
            written = commit;
            return true;
        });
        if (whole)
            push_stop(parent, written, std::max(at.from, from), at.to);
    }

    const graph::Frames<Memory>& frames_;
    SnapshotView<Memory> before_;  // the committed state
    SnapshotView<Memory> after_;   // with what the commit has written
    CycleScratch& scratch_;
};

}  // namespace tfdb::txn
