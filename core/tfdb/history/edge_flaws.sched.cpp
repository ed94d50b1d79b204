// The walks of edges can fail: they find each bug seeded here. The bugs are seeded between the
// protocol and its words, so the tested protocol is the shipped one.
#include "tfdb/history/edge.sched.hpp"
#include "tfdb/testing/sched/flaws.hpp"

namespace tfdb::history::script {

namespace {

using sched::BelievesFirst;
using sched::Delays;
using sched::Forgets;
using sched::LooksOnce;
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

/// All of the segments' words are stored after the store that makes them valid.
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

/// Drops the stores to a word.
MakeFlaw forgotten(HeaderWord word) {
    return [=](const SmallMemory& memory, const Places& places) {
        const Word* const chosen = &header_word(memory, places, word);
        return std::make_unique<Forgets>(
            [=](const Word& asked, std::uint64_t) { return &asked == chosen; });
    };
}
MakeFlaw reuse_forgotten() {
    return [](const SmallMemory& memory, const Places&) {
        const Word* const chosen = &memory.reclaimed(memory::Line::kReplaced);
        return std::make_unique<Forgets>(
            [=](const Word& asked, std::uint64_t) { return &asked == chosen; });
    };
}

MakeFlaw looked_at_once(HeaderWord word) {
    return [=](const SmallMemory& memory, const Places& places) {
        return std::make_unique<LooksOnce>(kReader, header_word(memory, places, word));
    };
}
MakeFlaw reuse_believed() {
    return [](const SmallMemory& memory, const Places&) {
        return std::make_unique<BelievesFirst>(kReader, memory.reclaimed(memory::Line::kReplaced));
    };
}

/// Takes a new snapshot for the second edge, but answers as for the first one.
bool read_of_two_snapshots(SmallMemory& memory, const Places& places, const Script& script,
                           const Model& model, StampNs stamp) {
    Taken<SmallMemory> first;
    Taken<SmallMemory> second;
    const std::uint64_t epoch = memory.word(places.epoch()).load_acquire();
    const CommitNumber snapshot = memory.word(places.commit).load_acquire();
    if (!take(memory, places.header(0), snapshot, epoch, script.history, stamp, first)) {
        return false;
    }
    const CommitNumber later = memory.word(places.commit).load_acquire();
    if (!take(memory, places.header(1), later, epoch, script.history, stamp, second)) {
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

const Script kAppends{.before = {one(10), one(20)}, .during = {one(30)}};
const Script kSeals{.before = {one(10), one(20)}, .during = {one(30), one(40), one(50)}};
const Script kEvicts{
    .history = 15, .before = {one(10), one(20)}, .during = {one(40), one(60), one(80)}};
const Script kLate{.before = {one(10), one(30)}, .during = {one(20), one(22), one(24)}};
const Script kClears{.before = {one(10), one(20)}, .during = {one(kClearMarker), one(5)}};
const Script kCorrects{.before = {one(10), one(10)}, .during = {one(10), one(10)}};
const Script kAborts{.before = {one(10)}, .during = {aborted(one(20)), one(15)}};

}  // namespace

TFDB_SCHED(edge_flaws_of_the_writer_are_found) {
    found("commit published before its samples", kAppends, 25, commit_first());
    found("tail stored before the slot", kAppends, 35, late_samples(kTail));
    found("tail stored before its commit is told", kAppends, 35, late(kChanged, kTail));
    found("an eviction that is not reported", kEvicts, 25, forgotten(kForgotten));
    found("directory stored before its entries", kSeals, 15, late_samples(kDirectory));
    found("a copy made part of the edge before it is filled", kLate, 15, late_samples(kTail));
    found("reused blocks that are not reported", kLate, 25, reuse_forgotten());
    found("version ended before readers are sent to it", kClears, 15, late(kSince, kTail));
    found("version ended, and readers not sent to it", kClears, 15, forgotten(kSince));
    found("a replacement that is not reported", kCorrects, 10, forgotten(kCorrected));
    found("abort of a sample that is not told to be newer", kAborts, 18, forgotten(kChanged));
}

TFDB_SCHED(edge_flaws_of_the_reader_are_found) {
    found("tail not looked at again after the directory",
          {.before = {one(20)}, .during = {one(10), one(30), one(40), one(50)}, .may_evict = false},
          15, looked_at_once(kTail));
    found("reuse not looked at again", kLate, 25, reuse_believed());
    found("a snapshot for each edge", {.edges = 2, .before = {both(10)}, .during = {both(20)}}, 15,
          {}, read_of_two_snapshots);
}

}  // namespace tfdb::history::script
