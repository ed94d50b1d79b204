// The walks of edges can fail: each bug seeded here is found. They are seeded between the protocol
// and its words, so the protocol itself is the one that ships.
#include "tfdb/history/edge.sched.hpp"
#include "tfdb/testing/sched/flaws.hpp"

namespace tfdb::history::script {

namespace {

using sched::BelievesFirst;
using sched::Delays;
using sched::Forgets;
using sched::Word;
const Word& header_word(const SmallMemory& memory, const Places& places, HeaderWord word) {
    return memory.word(places.header(0) + 8 * word);
}

MakeFlaw late(HeaderWord delayed, HeaderWord until) {
    return [=](const SmallMemory& memory, const Places& places) {
        const Word* const word = &header_word(memory, places, delayed);
        return std::make_unique<Delays>(
            kWriter, [word](const Word& asked) { return &asked == word; },
            header_word(memory, places, until));
    };
}

MakeFlaw late_after_commit(HeaderWord delayed) {
    return [=](const SmallMemory& memory, const Places& places) {
        const Word* const word = &header_word(memory, places, delayed);
        return std::make_unique<Delays>(
            kWriter, [word](const Word& asked) { return &asked == word; },
            memory.word(places.commit));
    };
}

/// All of the ring's words come after the store that makes them count.
MakeFlaw late_samples(HeaderWord until) {
    return [=](const SmallMemory& memory, const Places& places) {
        const Word* const end = &memory.word(places.header(1));
        return std::make_unique<Delays>(
            kWriter, [end](const Word& asked) { return &asked >= end; },
            header_word(memory, places, until));
    };
}

MakeFlaw commit_first() {
    return [](const SmallMemory& memory, const Places& places) {
        const Word* const commit = &memory.word(places.commit);
        return std::make_unique<Delays>(
            kWriter, [commit](const Word& asked) { return &asked != commit; }, *commit);
    };
}

MakeFlaw forgotten(HeaderWord word,
                   const std::function<bool(std::uint64_t now, std::uint64_t value)>& when) {
    return [=](const SmallMemory& memory, const Places& places) {
        const Word* const chosen = &header_word(memory, places, word);
        return std::make_unique<Forgets>([=](const Word& asked, std::uint64_t value) {
            return &asked == chosen && when(asked.peek(), value);
        });
    };
}

MakeFlaw believed(HeaderWord word) {
    return [=](const SmallMemory& memory, const Places& places) {
        return std::make_unique<BelievesFirst>(kReader, header_word(memory, places, word));
    };
}

/// Takes a new snapshot for the second edge, and answers as if it were the first one.
bool read_of_two_snapshots(SmallMemory& memory, const Places& places, const Script& script,
                           const Model& model, StampNs stamp) {
    Taken<SmallMemory> first;
    Taken<SmallMemory> second;
    const CommitNumber snapshot = memory.word(places.commit).load_acquire();
    if (!take(memory, places.header(0), snapshot, script.history, stamp, first)) {
        return false;
    }
    const CommitNumber later = memory.word(places.commit).load_acquire();
    if (!take(memory, places.header(1), later, script.history, stamp, second)) {
        return false;
    }
    judge(first, model.visible(snapshot, 0), stamp, require);
    judge(second, model.visible(snapshot, 1), stamp, require);
    return true;
}

void found(const std::string& name, const Script& script, StampNs stamp, const MakeFlaw& flaw,
           Read reader = read_soundly) {
    sched::Walk().must_fail(name, "snapshot:", program(script, stamp, 2, flaw, reader));
}

const Script kAppends{.before = {one(10)}, .during = {one(20)}};
const Script kEvicts{.history = 15, .before = {one(10), one(30)}, .during = {one(50)}};
const Script kGrows{.before = {one(10), one(20)}, .during = {one(30)}};
const Script kAborts{.before = {one(10)}, .during = {aborted(one(20))}};
const Script kAbortsLate{.before = {one(10), one(30)}, .during = {aborted(one(20)), one(40)}};
const Script kSorts{.before = {one(17), one(37), {{{0, 15}, {0, 19}}}}, .during = {one(11)}};

bool always(std::uint64_t, std::uint64_t) {
    return true;
}
bool same_ring(std::uint64_t now, std::uint64_t value) {
    return RingWord::is_busy(value) || RingWord::block(now) == RingWord::block(value);
}
bool busy_ring(std::uint64_t, std::uint64_t value) {
    return RingWord::is_busy(value);
}

}  // namespace

TFDB_SCHED(edge_flaws_of_the_writer_are_found) {
    found("commit published before its samples", kAppends, 15, commit_first());
    found("head stored before the slot", kAppends, 15, late_samples(kHead));
    found("head stored before its commit", kAppends, 15, late(kHeadCommit, kHead));
    found("flag of lateness set after the commit",
          {.before = {one(10), one(30)}, .during = {one(20)}}, 25, late_after_commit(kTopology));
    found("begin announced after the overwrite", kEvicts, 5, late(kBegin, kHead));
    found("nobody told what was overwritten",
          {.history = 15, .before = {one(10)}, .during = {one(30), one(50)}}, 15,
          forgotten(kEvictSafe, always));
    found("ring published before its samples are copied", kGrows, 15, late_samples(kRing));
    found("abort of a sample that is not told to be newer", kAborts, 15,
          forgotten(kHeadCommit, always));
    found("abort that turns no reader back", kAbortsLate, 35, forgotten(kRing, same_ring));
    found("samples sorted anew beside readers", kSorts, 40, forgotten(kRing, busy_ring));
    found("clear that turns no reader back",
          {.before = {one(1), {{{0, 0}, {0, 4}}}, {{{0, 14}, {0, 3}}}},
           .during = {one(kClearMarker), one(3)},
           .may_evict = false},
          70, forgotten(kRing, same_ring));
}

TFDB_SCHED(edge_flaws_of_the_reader_are_found) {
    found("begin not looked at again", kEvicts, 20, believed(kBegin));
    found("ring not looked at again after a growth",
          {.before = {one(10), one(20)}, .during = {one(30), one(40), one(50)}}, 15,
          believed(kRing));
    found("a snapshot for each edge", {.edges = 2, .before = {both(10)}, .during = {both(20)}}, 15,
          {}, read_of_two_snapshots);
}

}  // namespace tfdb::history::script
