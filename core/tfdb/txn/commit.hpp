// One commit in progress: what it made, wrote and removed, until it is published or undone.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/graph/frames.hpp"
#include "tfdb/graph/names.hpp"
#include "tfdb/history/edge_writer.hpp"
#include "tfdb/txn/cycle_search.hpp"
#include "tfdb/txn/depth_hints.hpp"
#include "tfdb/txn/feed.hpp"
#include "tfdb/txn/frame_set.hpp"
#include "tfdb/txn/snapshot_view.hpp"

namespace tfdb::txn {

/// Lists that a commit fills; kept by the store, so that no commit allocates in steady state.
struct CommitScratch {
    /// A frame that the commit changes. One that it makes and removes again comes twice.
    struct Touched {
        FrameId id;
        FrameId old_parent;     // newest parent before this commit
        std::uint64_t samples;  // how many this commit adds, where they are counted
        std::uint64_t note;     // its position in the feed
        std::uint64_t author;   // of those samples
        unsigned what;          // bits of FeedNote::What
        bool written;           // by `touch`
        bool one;               // it adds one, where they are not counted
    };
    std::vector<Touched> touched;
    FrameSet touched_frames;            // where each stands in `touched`, removals aside
    FrameSet going;                     // to be removed
    std::vector<std::uint32_t> depths;  // by frame
    std::vector<FrameId> climb;
    CycleScratch cycles;
};

/// Notes in a frame's header, after the commit, its maker and the writer of its samples. `what`: of
/// its note; `author` and `source` by their numbers, `source` as in `Commit`.
template <class Memory>
void set_writer(const graph::Frames<Memory>& frames, FrameId id, unsigned what, bool has_samples,
                std::uint64_t author, std::uint64_t source) {
    if ((what & FeedNote::kRemoved) != 0)
        return;
    // Only a copy clears an edge in the name of its last writer.
    const bool names_author = has_samples || ((what & FeedNote::kCleared) != 0 && author != 0);
    if (auto& last = frames.word(id, history::kAuthority);
        names_author && last.load_relaxed() != author)
        last.store_relaxed(author);
    using history::SourceWord;
    if (source == SourceWord::kNoSources) [[likely]]
        return;
    auto& word = frames.word(id, history::kSource);
    const std::uint64_t before = word.load_relaxed();
    const bool made = (what & FeedNote::kMade) != 0;
    const bool cleared = (what & FeedNote::kCleared) != 0;
    const std::uint64_t writer = has_samples ? source : cleared ? 0 : SourceWord::writer(before);
    word.store_relaxed(SourceWord::pack(made ? source : SourceWord::maker(before), writer));
}

/// Writes of one commit. Nothing is visible before `publish`; the destructor undoes what was not
/// published.
/// Threads: only the holder of the commit lock, from construction to destruction.
/// Guarantee: all or nothing, also when a call throws.
template <class Memory>
class Commit {
public:
    /// `readers` is asked only when a segment is full or a slot is to be reused, and outlives it.
    /// `author`: as in `set_author`. `source`: the number of the source that all of it comes from,
    /// 0 for a writer of this store, or kNoSources: see history::SourceWord.
    Commit(graph::Frames<Memory> frames, CommitScratch& scratch, clock::StampNs history,
           history::Readers& readers, std::uint64_t author = 0,
           std::uint64_t source = history::SourceWord::kNoSources)
        : frames_(frames),
          names_(frames),
          scratch_(scratch),
          context_(frames.store_word(graph::kCommit).load_relaxed(), history, readers),
          readers_(readers),
          feed_(frames, context_.committed),
          author_(author),
          source_(source) {
        if (context_.committed >= kMaxCommit - 1) {
            throw CapacityExceeded("the store has used up its commit numbers: start a new one");
        }
        scratch_.touched.clear();
        scratch_.cycles.relations.clear();
        scratch_.touched_frames.clear();
        scratch_.going.clear();
    }

    ~Commit() {
        if (!published_)
            abort();
    }

    Commit(const Commit&) = delete;
    Commit& operator=(const Commit&) = delete;

    [[nodiscard]] CommitNumber number() const { return context_.committed + 1; }
    /// The forest with what was written so far.
    [[nodiscard]] SnapshotView<Memory> view() const {
        return {frames_, number(), context_.history};
    }

    /// The number of the authority of the samples whose frames are touched from now on.
    void set_author(std::uint64_t author) { author_ = author; }

    /// Calls visit(id, removed) for each frame whose samples it changes, or that it removes.
    template <class Visit>
    void for_each_change(Visit visit) const {
        for (const Touched& touched : scratch_.touched) {
            const bool removed = (touched.what & FeedNote::kRemoved) != 0;
            if (removed || touched.written)
                visit(touched.id, removed);
        }
    }

    /// The frame of that name as this commit sees it, or kNoFrame.
    [[nodiscard]] FrameId find_frame(std::string_view name) const {
        return names_.find(name, number());
    }

    /// The frame of that name, made where it is missing. Throws CapacityExceeded.
    [[nodiscard]] FrameId frame(std::string_view name) {
        const FrameId found = find_frame(name);
        if (found != kNoFrame) {
            return found;
        }
        names_.reserve();
        const Offset block = names_.store_name(name);
        FrameId id = kNoFrame;
        try {
            // From where a slot is taken on nothing throws.
            reserve_touched();
            scratch_.touched_frames.make_room(frames_.count());
            id = take_slot();
        } catch (...) {
            names_.free_name(block);
            throw;
        }
        scratch_.touched_frames.insert(id, static_cast<std::uint32_t>(scratch_.touched.size()));
        const std::uint64_t note = feed_.note(id, FeedNote::kMade, 0, author_);
        scratch_.touched.push_back({id, kNoFrame, 0, note, author_, FeedNote::kMade, false, false});
        frames_.make(id, number(), block);
        names_.insert(name, id);
        return id;
    }

    /// True if this commit has written to the frame before; marks it as written. Inline, so that a
    /// batch waits for the headers of many frames at once.
    [[nodiscard, gnu::always_inline]] bool touch(FrameId child) {
        const auto place = static_cast<std::uint32_t>(scratch_.touched.size());
        if (!scratch_.touched_frames.insert(child, place)) {
            touched(child).author = author_;
            return std::exchange(touched(child).written, true);
        }
        scratch_.touched.push_back({child, newest_parent(child), 0, 0, author_, 0, true, true});
        scratch_.touched.back().note = feed_.note(child, 0, 1, author_);
        return false;
    }

    /// Appends the one sample of an edge, or the last one of a static edge; `touch(child)` came
    /// before.
    void append(FrameId child, const history::NewSample<Memory>& sample, std::size_t item) {
        auto edge = writer(child);
        const FrameId old_parent = history::Topology::parent(edge.topology());
        relate(child, sample, edge.newest(), item);
        edge.append(context_, sample);
        // Otherwise the feed has it already.
        if (old_parent != sample.parent)
            touched(child).one = true;
        hint_depth(child, old_parent, sample.parent);
    }
    /// The same for samples that come after each other, in the order of their stamps: some of those
    /// of the edge. `item_of(i)` says which one is which.
    template <class ItemOf>
    void append(FrameId child, std::span<const history::NewSample<Memory>> samples,
                ItemOf item_of) {
        if (samples.size() == 1) {
            append(child, samples.front(), item_of(0));
            ++touched(child).samples;
            return;
        }
        auto edge = writer(child);
        if (samples.front().stamp > edge.newest()) {
            for (std::size_t first = 0; first < samples.size();) {
                const FrameId parent = samples[first].parent;
                std::size_t last = first + 1;
                while (last < samples.size() && samples[last].parent == parent)
                    ++last;
                const auto sample = [&](std::size_t i) -> const history::NewSample<Memory>& {
                    return samples[first + i];
                };
                append_ahead(child, parent, last - first, sample,
                             [&](std::size_t i) { return item_of(first + i); });
                first = last;
            }
            return;
        }
        const FrameId old_parent = history::Topology::parent(edge.topology());
        for (std::size_t i = 0; i < samples.size(); ++i) {
            scratch_.cycles.relations.push_back(
                {child, samples[i].parent, samples[i].stamp, item_of(i)});
        }
        edge.append(context_, samples);
        touched(child).samples += samples.size();
        hint_depth(child, old_parent, history::Topology::parent(edge.topology()));
    }
    /// The same for moving samples of one parent that are ahead of all others; `sample(i)` gives
    /// them.
    template <class Sample, class ItemOf>
    void append_ahead(FrameId child, FrameId parent, std::size_t count, Sample sample,
                      ItemOf item_of) {
        auto edge = writer(child);
        const std::uint64_t topology = edge.topology();
        const FrameId old_parent = history::Topology::parent(topology);
        // As in `relate`: the first sample of all makes its parent the one that they all have.
        const bool mixed = (topology & history::Topology::kMixedParents) != 0 ||
                           (edge.has_samples() && parent != old_parent);
        const std::size_t related = mixed ? count : parent != old_parent ? 1 : 0;
        for (std::size_t i = 0; i < related; ++i)
            scratch_.cycles.relations.push_back({child, parent, sample(i).stamp, item_of(i)});
        edge.append_behind(context_, count, sample);
        touched(child).samples += count;
        hint_depth(child, old_parent, parent);
    }

    /// Hides all samples of an edge; `touch(child)` came before. Once in a commit at most.
    void clear(FrameId child) {
        writer(child).clear(context_);
        touched(child).what |= FeedNote::kCleared;
        touched(child).one = false;
        what_ |= FeedNote::kCleared;
        frames_.refresh_hint(child);
    }

    /// The same for all edges that move, but those of frames for which `skip(id)` is true; before
    /// anything is written to them.
    template <class Skip>
    void clear_moving(Skip skip) {
        const SnapshotView<Memory> before(frames_, context_.committed, context_.history);
        for (FrameId id = 0; id < frames_.count(); ++id) {
            if (!before.alive(id) || writer(id).newest() < 0 || skip(id))
                continue;
            (void)touch(id);
            clear(id);
        }
    }

    /// How many samples of an edge came out of order; `touch(child)` came before.
    void set_late(FrameId child, std::uint64_t samples) {
        writer(child).set_late(context_, samples);
    }

    /// The frame exists no longer; nothing names it as its newest parent.
    void remove(FrameId id) {
        reserve_touched();
        const Offset name = names_.name_block(id);
        feed_.note_removal(id, names_.stored_size(name), [&](std::uint64_t i) {
            return frames_.memory().word(name + 8 * (i + 1)).load_relaxed();
        });
        scratch_.touched.push_back({id, kNoFrame, 0, 0, 0, FeedNote::kRemoved, false, false});
        what_ |= FeedNote::kRemoved;
        frames_.word(id, history::kDied).store_relaxed(number());
        auto& topology = frames_.word(id, history::kTopology);
        topology.store_release(topology.load_relaxed() | history::Topology::kMortal);
    }

    /// What looks for cycles among what was appended.
    [[nodiscard]] CycleSearch<Memory> cycles() {
        return {frames_, context_.committed, context_.history, scratch_.cycles};
    }
    /// Makes all of it visible at once. Where it throws, nothing has become visible.
    CommitNumber publish() {
        return publish([] {});
    }
    /// The same; calls `before()`, which throws nothing, when nothing else can fail.
    template <class Before>
    CommitNumber publish(Before before) {
        refresh_depths();
        before();
        count_children();
        for (const Touched& touched : scratch_.touched) {
            const std::uint64_t samples = std::max<std::uint64_t>(touched.one, touched.samples);
            if ((touched.what | touched.samples) != 0 && (touched.what & FeedNote::kRemoved) == 0)
                feed_.correct(touched.note, touched.id, touched.what, samples, touched.author);
        }
        frames_.store_word(graph::kCommit).store_release(number());
        published_ = true;
        // Behind the commit: after a death between, `Repair` does the same by the feed.
        for (const Touched& touched : scratch_.touched) {
            set_writer(frames_, touched.id, touched.what, touched.one || touched.samples != 0,
                       touched.author, source_);
        }
        if ((what_ & (FeedNote::kCleared | FeedNote::kRemoved)) != 0)
            let_go();
        return number();
    }

    /// The parent that the newest sample names, kNoFrame for a root.
    [[nodiscard]] FrameId newest_parent(FrameId id) const {
        return txn::newest_parent(frames_, id, number(), context_.history);
    }

    /// What a removed frame keeps beside its samples: the slot, and its name as a rule.
    static constexpr std::uint64_t kFrameBytes = history::kHeaderBytes + memory::kLineBytes;
    /// Gives back what removed frames hold. Asked anew: a snapshot that is not seen here has seen
    /// the commit that was just published.
    void empty_removed() {
        const CommitNumber oldest = readers_.oldest_read();
        // Each frame is in the list once, but where that was damaged.
        for (std::uint32_t left = frames_.count(); left > 0; --left) {
            const FrameId id = frames_.first_full();
            if (id == kNoFrame || frames_.word(id, history::kDied).load_relaxed() > oldest)
                return;
            frames_.pass_full();
            empty_slot(id);
        }
    }

    /// Takes out of use what no state that is still read retains of the edges' histories.
    void evict_all() {
        for (FrameId id = 0; id < frames_.count(); ++id)
            writer(id).evict_all(context_);
    }

private:
    using Touched = CommitScratch::Touched;
    /// Of a frame that `touch` or `frame` was called for.
    [[nodiscard]] Touched& touched(FrameId id) const {
        return scratch_.touched[scratch_.touched_frames.place(id)];
    }
    void reserve_touched() const {
        // `reserve` alone grows to the very number asked for.
        if (scratch_.touched.size() == scratch_.touched.capacity())
            scratch_.touched.reserve(2 * scratch_.touched.size() + 8);
    }

    /// A sample ahead of all others, of the parent that they all have, relates nothing anew.
    void relate(FrameId child, const history::NewSample<Memory>& sample, clock::StampNs newest,
                std::size_t item) {
        using history::Topology;
        const std::uint64_t topology = frames_.topology(child);
        const bool same_parent = Topology::parent(topology) == sample.parent &&
                                 (topology & Topology::kMixedParents) == 0;
        if (!same_parent || (sample.stamp != history::kStaticStamp && sample.stamp <= newest))
            scratch_.cycles.relations.push_back({child, sample.parent, sample.stamp, item});
    }
    /// After a sample that may name another parent than the newest one.
    void hint_depth(FrameId child, FrameId old_parent, FrameId parent) {
        using history::Topology;
        if (old_parent == parent)
            return;
        writer(child).set_depth_hint(Topology::depth(frames_.topology(parent)) + 1);
        frames_.refresh_hint(child);
        depths_stale_ |= frames_.word(child, history::kChildren).load_relaxed() != 0;
    }
    [[nodiscard]] history::EdgeWriter<Memory> writer(FrameId id) const {
        return {frames_.memory(), frames_.header(id)};
    }
    /// Slots are reused oldest first, and only when no held snapshot can still ask for their frame.
    [[nodiscard]] FrameId take_slot() {
        const FrameId fresh = frames_.take_fresh_slot();
        // Each is in the list once, but where that was damaged.
        for (std::uint32_t left = frames_.count(); left > 0; --left) {
            const FrameId retired = frames_.first_retired();
            if (retired == kNoFrame)
                break;
            const CommitNumber died = frames_.word(retired, history::kDied).load_relaxed();
            // Zero: made by a commit that was undone.
            if (died != 0 &&
                (died > context_.committed || (fresh != kNoFrame && died > context_.oldest_read())))
                break;
            const bool full = retired == frames_.first_full();
            const bool worn_out = frames_.generation(retired) == frames_.kLastGeneration;
            frames_.pop_retired();
            if (full)
                empty_slot(retired);
            // A handle to the slot's first frame must not fit again.
            if (!worn_out)
                return retired;
        }
        if (fresh == kNoFrame) {
            throw CapacityExceeded("the store holds max_frames = " +
                                   std::to_string(frames_.max_frames()) + " frames already");
        }
        frames_.seal(fresh);
        return fresh;
    }

    /// A reader of the removed frame finds out: it has been born anew, and states in which
    /// it lived lie below the floor.
    void empty_slot(FrameId id) {
        const CommitNumber died = frames_.word(id, history::kDied).load_relaxed();
        auto& floor = frames_.store_word(graph::kRecycleFloor);
        floor.store_release(std::max<std::uint64_t>(floor.load_relaxed(), died));
        frames_.seal(id);
        const Offset name = frames_.word(id, history::kName).load_relaxed();
        names_.erase(id);
        frames_.word(id, history::kName).store_release(0);
        Memory::fence_release();
        names_.free_name(name);
        writer(id).release(context_);
        readers_.held(std::uint64_t{0} - kFrameBytes);
    }

    /// After the commit: what only older states show.
    void let_go() {
        for (const Touched& touched : scratch_.touched) {
            if ((touched.what & FeedNote::kCleared) != 0)
                writer(touched.id).retire_older(context_);
            if ((touched.what & FeedNote::kRemoved) == 0)
                continue;
            if (context_.is_held())
                writer(touched.id).hold_all(context_);
            readers_.held(kFrameBytes);
            frames_.push_retired(touched.id);
        }
        if ((what_ & FeedNote::kRemoved) != 0)
            empty_removed();
    }

    /// Counts, for every frame, how many have it as their newest parent: `remove` asks for it.
    void count_children() {
        const auto count = [&](FrameId parent, std::uint64_t delta) {
            if (parent == kNoFrame)
                return;
            auto& children = frames_.word(parent, history::kChildren);
            children.store_relaxed(children.load_relaxed() + delta);
        };
        // Where no relation is new, all parents are as before.
        if (scratch_.cycles.relations.empty() && what_ == 0)
            return;
        for (Touched& touched : scratch_.touched) {
            const FrameId parent = newest_parent(touched.id);
            if ((touched.what & FeedNote::kRemoved) != 0) {
                count(parent, ~std::uint64_t{0});
            } else if (parent != touched.old_parent) {
                count(touched.old_parent, ~std::uint64_t{0});
                count(parent, 1);
                if ((touched.what & FeedNote::kMade) == 0)
                    touched.what |= FeedNote::kMoved;
            }
        }
    }

    /// Gives every frame the depth that it has now. Robots are often announced from the leaves
    /// upward: with the depths of that time, walks between two branches would climb past their
    /// meeting point.
    void refresh_depths() {
        // Beyond, stale hints cost less than this, unless the commit itself is as large.
        constexpr std::uint32_t kMostFrames = 4096;
        const std::uint32_t count = frames_.count();
        if (!depths_stale_ || (count > kMostFrames && count / 4 > scratch_.touched.size())) {
            return;
        }
        txn::refresh_depths(frames_, scratch_.depths, scratch_.climb);
    }

    void abort() {
        for (const Touched& touched : scratch_.touched) {
            if ((touched.what & FeedNote::kRemoved) != 0)
                frames_.revive(touched.id);
            if (touched.written)
                take_back(touched);
        }
        for (const Touched& touched : scratch_.touched) {
            if ((touched.what & FeedNote::kMade) != 0)
                unmake(touched.id);
        }
    }
    void take_back(const Touched& touched) {
        auto edge = writer(touched.id);
        edge.trim(context_);
        const FrameId parent = history::Topology::parent(edge.topology());
        if (parent != kNoFrame)
            edge.set_depth_hint(history::Topology::depth(frames_.topology(parent)) + 1);
        frames_.refresh_hint(touched.id);
    }
    void unmake(FrameId id) {
        const Offset name = frames_.word(id, history::kName).load_relaxed();
        names_.erase(id);
        frames_.seal(id);
        frames_.word(id, history::kName).store_release(0);
        Memory::fence_release();
        names_.free_name(name);
        writer(id).release(context_);
        frames_.push_unseen(id);
    }

    graph::Frames<Memory> frames_;
    graph::Names<Memory> names_;
    CommitScratch& scratch_;
    history::WriteContext context_;
    history::Readers& readers_;
    FeedWriter<Memory> feed_;
    std::uint64_t author_;
    std::uint64_t source_;
    unsigned what_ = 0;  // happened to any frame: clears and removals
    bool published_ = false;
    bool depths_stale_ = false;  // a frame with children got another parent
};

}  // namespace tfdb::txn
