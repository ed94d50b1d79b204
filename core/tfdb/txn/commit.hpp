// One commit in progress: the frames and samples that it creates, writes and removes, until it is
// published or undone.
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

/// Lists that a commit fills; the store keeps them, so that no commit allocates in steady state.
struct CommitScratch {
    /// A frame that the commit changes. A frame that it creates and removes is listed twice.
    struct Touched {
        FrameId id;
        FrameId old_parent;     // newest parent before this commit
        std::uint64_t samples;  // number of samples that this commit adds, if they are counted
        std::uint64_t note;     // its position in the feed
        std::uint64_t author;   // authority of those samples
        unsigned what;          // bits of FeedNote::What
        bool written;           // by `touch`
        bool one;               // it adds one sample, if samples are not counted
    };
    std::vector<Touched> touched;
    FrameSet touched_frames;            // position of each frame in `touched`, except removals
    FrameSet going;                     // to be removed
    std::vector<std::uint32_t> depths;  // by frame
    std::vector<FrameId> climb;
    CycleScratch cycles;
};

/// Writes a commit's results into a frame's header: the commit, its creator and the samples'
/// writer. `what`: bits of its note; `author` and `source` are numbers, `source` as in `Commit`.
template <class Memory>
void set_writer(const graph::Frames<Memory>& frames, FrameId id, unsigned what, bool has_samples,
                std::uint64_t author, std::uint64_t source) {
    if ((what & FeedNote::kRemoved) != 0)
        return;
    // Only a copied commit clears an edge in the name of its last writer.
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
    word.store_relaxed(made ? SourceWord::pack(source, writer)
                            : SourceWord::with_writer(before, writer));
}

/// Writes of one commit. Nothing is visible before `publish`; the destructor undoes an unpublished
/// commit.
/// Threads: only the holder of the commit lock, from construction to destruction.
/// Guarantee: all or nothing, even if a call throws.
template <class Memory>
class Commit {
public:
    /// `readers` must outlive it; it is called only if a segment is full or a slot is to be reused.
    /// `author`: as in `set_author`. `source`: the number of the source of the whole commit, 0 for
    /// a writer of this store, or kNoSources: see history::SourceWord.
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
    /// The forest including the writes so far.
    [[nodiscard]] SnapshotView<Memory> view() const {
        return {frames_, number(), context_.history};
    }

    /// Sets the number of the authority for the frames touched from now on.
    void set_author(std::uint64_t author) { author_ = author; }

    /// Calls visit(id, removed) for each frame that it removes or whose samples it changes.
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

    /// The frame of that name, created if missing. Throws CapacityExceeded.
    [[nodiscard]] FrameId frame(std::string_view name) {
        const FrameId found = find_frame(name);
        if (found != kNoFrame) {
            return found;
        }
        names_.reserve();
        const Offset block = names_.store_name(name);
        FrameId id = kNoFrame;
        try {
            // Nothing throws after a slot was taken.
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

    /// Whether this commit has written to the frame before; marks it as written. Inline, so that a
    /// batch overlaps the cache misses of many frames' headers.
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

    /// Appends a single sample of an edge, or the last one of a static edge. Requires
    /// `touch(child)`.
    void append(FrameId child, const history::NewSample<Memory>& sample, std::size_t item) {
        auto edge = writer(child);
        const FrameId old_parent = history::Topology::parent(edge.topology());
        relate(child, sample, edge.newest(), item);
        edge.append(context_, sample);
        // Otherwise the feed already contains it.
        if (old_parent != sample.parent)
            touched(child).one = true;
        hint_depth(child, old_parent, sample.parent);
    }
    /// The same for several samples of the edge in stamp order. `item_of(i)` returns the item of
    /// the i-th sample.
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
    /// The same for moving samples of one parent, all newer than the edge's samples; `sample(i)`
    /// returns them.
    template <class Sample, class ItemOf>
    void append_ahead(FrameId child, FrameId parent, std::size_t count, Sample sample,
                      ItemOf item_of) {
        auto edge = writer(child);
        const std::uint64_t topology = edge.topology();
        const FrameId old_parent = history::Topology::parent(topology);
        // As in `relate`: an edge's first sample makes its parent the common one.
        const bool mixed = (topology & history::Topology::kMixedParents) != 0 ||
                           (edge.has_samples() && parent != old_parent);
        const std::size_t related = mixed ? count : parent != old_parent ? 1 : 0;
        for (std::size_t i = 0; i < related; ++i)
            scratch_.cycles.relations.push_back({child, parent, sample(i).stamp, item_of(i)});
        edge.append_behind(context_, count, sample);
        touched(child).samples += count;
        hint_depth(child, old_parent, parent);
    }

    /// Hides all samples of an edge. Requires `touch(child)`. At most once per commit.
    void clear(FrameId child) {
        writer(child).clear(context_);
        touched(child).what |= FeedNote::kCleared;
        touched(child).one = false;
        what_ |= FeedNote::kCleared;
        frames_.refresh_hint(child);
    }

    /// The same for all moving edges, except frames with `skip(id)`. Call before any write to them.
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

    /// Sets an edge's count of out-of-order samples. Requires `touch(child)`.
    void set_late(FrameId child, std::uint64_t samples) {
        writer(child).set_late(context_, samples);
    }

    /// Removes the frame; no frame may name it as its newest parent.
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

    /// The cycle search over the appended samples.
    [[nodiscard]] CycleSearch<Memory> cycles() {
        return {frames_, context_.committed, context_.history, scratch_.cycles};
    }
    /// Makes everything visible at once. If it throws, nothing has become visible.
    CommitNumber publish() {
        return publish([] {});
    }
    /// The same; calls `before()`, which must not throw, once nothing else can fail.
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
        // After the commit word: if the process dies in between, `Repair` does the same from the
        // feed.
        for (const Touched& touched : scratch_.touched) {
            set_writer(frames_, touched.id, touched.what, touched.one || touched.samples != 0,
                       touched.author, source_);
        }
        if ((what_ & (FeedNote::kCleared | FeedNote::kRemoved)) != 0)
            retire_unneeded();
        return number();
    }

    /// The parent in the newest sample; kNoFrame for a root.
    [[nodiscard]] FrameId newest_parent(FrameId id) const {
        return txn::newest_parent(frames_, id, number(), context_.history);
    }

    /// Memory of a removed frame besides its samples: the slot, and usually its name.
    static constexpr std::uint64_t kFrameBytes = history::kHeaderBytes + memory::kLineBytes;
    /// Frees the memory of removed frames. It asks for pins again: a snapshot that it misses has
    /// already seen the commit just published.
    void empty_removed() {
        const CommitNumber oldest = readers_.oldest_read();
        // Each frame is in the list once, unless the list is damaged.
        for (std::uint32_t left = frames_.count(); left > 0; --left) {
            const FrameId id = frames_.first_full();
            if (id == kNoFrame || frames_.word(id, history::kDied).load_relaxed() > oldest)
                return;
            frames_.pass_full();
            empty_slot(id);
        }
    }

    /// Evicts the parts of the edges' histories that no readable state retains.
    void evict_all() {
        for (FrameId id = 0; id < frames_.count(); ++id)
            writer(id).evict_all(context_);
    }

private:
    using Touched = CommitScratch::Touched;
    /// Requires `touch` or `frame` for the frame before.
    [[nodiscard]] Touched& touched(FrameId id) const {
        return scratch_.touched[scratch_.touched_frames.place(id)];
    }
    void reserve_touched() const {
        // `reserve` alone would grow to exactly the requested size.
        if (scratch_.touched.size() == scratch_.touched.capacity())
            scratch_.touched.reserve(2 * scratch_.touched.size() + 8);
    }

    /// A sample newer than all others with the edge's only parent adds no relation.
    void relate(FrameId child, const history::NewSample<Memory>& sample, clock::StampNs newest,
                std::size_t item) {
        using history::Topology;
        const std::uint64_t topology = frames_.topology(child);
        const bool same_parent = Topology::parent(topology) == sample.parent &&
                                 (topology & Topology::kMixedParents) == 0;
        if (!same_parent || (sample.stamp != history::kStaticStamp && sample.stamp <= newest))
            scratch_.cycles.relations.push_back({child, sample.parent, sample.stamp, item});
    }
    /// Call after a sample that may change the newest parent.
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
    /// Slots are reused oldest first, and only when no held snapshot can read their frame.
    [[nodiscard]] FrameId take_slot() {
        const FrameId fresh = frames_.take_fresh_slot();
        // Each slot is in the list once, unless the list is damaged.
        for (std::uint32_t left = frames_.count(); left > 0; --left) {
            const FrameId retired = frames_.first_retired();
            if (retired == kNoFrame)
                break;
            const CommitNumber died = frames_.word(retired, history::kDied).load_relaxed();
            // Zero: created by a commit that was undone.
            if (died != 0 &&
                (died > context_.committed || (fresh != kNoFrame && died > context_.oldest_read())))
                break;
            const bool full = retired == frames_.first_full();
            const bool worn_out = frames_.generation(retired) == frames_.kLastGeneration;
            frames_.pop_retired();
            if (full)
                empty_slot(retired);
            // A handle to the slot's first frame must never match again.
            if (!worn_out)
                return retired;
        }
        if (fresh == kNoFrame) {
            throw CapacityExceeded("the store already has max_frames = " +
                                   std::to_string(frames_.max_frames()) + " frames");
        }
        frames_.seal(fresh);
        return fresh;
    }

    /// A reader of the removed frame detects it: the slot has been born again, and the states of
    /// the old frame lie below the floor.
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

    /// After the commit: frees data that only older states show.
    void retire_unneeded() {
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

    /// Counts the children of every frame by newest parents; `remove` depends on it.
    void count_children() {
        const auto count = [&](FrameId parent, std::uint64_t delta) {
            if (parent == kNoFrame)
                return;
            auto& children = frames_.word(parent, history::kChildren);
            children.store_relaxed(children.load_relaxed() + delta);
        };
        // Without new relations all parents are unchanged.
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

    /// Computes every frame's depth. Robots often publish from the leaves upward: with the depths
    /// of that time, walks between two branches would climb past their meeting point.
    void refresh_depths() {
        // Beyond this size, outdated hints cost less, unless the commit itself is that large.
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
                undo_frame(touched.id);
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
    void undo_frame(FrameId id) {
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
    unsigned what_ = 0;  // of any frame: clears and removals
    bool published_ = false;
    bool depths_stale_ = false;  // a frame with children changed its parent
};

}  // namespace tfdb::txn
