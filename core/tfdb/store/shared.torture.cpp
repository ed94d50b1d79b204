// Writers of a store that processes share are killed at random, also while they repair what another
// one left; readers beside them judge every answer, and afterwards nothing that was committed is
// missing, nothing leaks and everything can still be done.
//
//   torture_store_shared [--seconds 20] [--seed 1] [--writers 3] [--readers 2]
//
// Built with TFDB_COUNTS_STORES, writers also die before a chosen store to shared memory, counted
// from the beginning of a call.
#include <sched.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <memory>
#include <new>
#include <optional>
#include <random>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/store/buffer.hpp"
#include "tfdb/store/fixture.hpp"
#include "tfdb/store/transaction.hpp"
#include "tfdb/sync/word.hpp"
#include "tfdb/testing/options.hpp"

namespace tfdb {
namespace {

using fixture::number_of;
using fixture::pose_of;
using sync::Word;

constexpr StampNs kMilli = 1'000'000;
constexpr StampNs kFirstStamp = clock::kNanosPerSecond;
constexpr std::size_t kMebi = std::size_t{1} << 20;
constexpr unsigned kMostWriters = 8;
constexpr unsigned kMostReaders = 8;
constexpr unsigned kJoints = 4;
constexpr unsigned kRecent = 16;
constexpr unsigned kOps = 8;
constexpr unsigned kWhoClears = 0;  // this writer, and no other one
constexpr unsigned kNoProgressSeconds = 60;

struct Options {
    unsigned seconds = 20;
    unsigned seed = 1;
    unsigned writers = 3;
    unsigned readers = 2;
};

// -- what the processes tell each other, beside the store
// ------------------------------------------

/// What one writer has begun, and what it has been told is done.
struct WriterNotes {
    Word begun;  // number of the arm
    Word done;
    Word clears_before;  // ended before the arm was stored
    Word kind_begun;
    Word kind_done;
    Word made;  // number of the frame that came last, 0 once its removal began
    Word late_at;
    std::array<Word, kRecent> late;  // stamps of late samples that are done
};
struct ReaderNotes {
    Word rounds;
    Word answers;
    Word too_old;  // held states that were given up
};

/// In memory of all these processes.
struct Board {
    Word ends;
    Word failures;
    Word clears;  // begun
    Word clears_ended;
    Word shared_done;  // greatest number of the arm that all writers move
    std::array<WriterNotes, kMostWriters> writers;
    std::array<ReaderNotes, kMostReaders> readers;
};

Board* g_board = nullptr;

void report(const char* text) {
    if (g_board->failures.fetch_add(1) <= 20)
        std::fprintf(stderr, "FAILED (process %d): %s\n", static_cast<int>(::getpid()), text);
}
template <class... Values>
void fail(const char* format, Values... values) {
    std::array<char, 512> text{};
    std::snprintf(text.data(), text.size(), format, values...);
    report(text.data());
}
void fail(const char* text) {
    report(text);
}

void raise_to(Word& word, std::uint64_t value) {
    std::uint64_t now = word.load_acquire();
    while (now < value && !word.compare_exchange(now, value)) {
    }
}

// -- deaths
// ----------------------------------------------------------------------------------------

#ifdef TFDB_COUNTS_STORES
std::uint64_t g_stores_left = 0;
#endif

/// Kills this process some time after now, or before its n-th store to shared memory.
class Death {
public:
    explicit Death(std::mt19937_64& random) : random_(random) {
        sigevent event{};
        event.sigev_notify = SIGEV_SIGNAL;
        event.sigev_signo = SIGKILL;
        if (::timer_create(CLOCK_MONOTONIC, &event, &timer_) != 0)
            fail("timer_create: %s", std::strerror(errno));
    }

    /// Most deaths soon, so that they hit the call that follows, few late.
    void arm() {
#ifdef TFDB_COUNTS_STORES
        if (random_() % 4 != 0) {
            g_stores_left = up_to(2000);
            return;
        }
#endif
        itimerspec when{};
        when.it_value.tv_nsec = static_cast<long>(up_to(1'000'000));
        ::timer_settime(timer_, 0, &when, nullptr);
    }

private:
    /// Every order of magnitude is as likely as another one.
    std::uint64_t up_to(std::uint64_t most) {
        const double share = std::uniform_real_distribution<>(0.0, 1.0)(random_);
        return 1 + static_cast<std::uint64_t>(std::pow(static_cast<double>(most), share));
    }

    std::mt19937_64& random_;
    timer_t timer_{};
};

// -- the world
// -------------------------------------------------------------------------------------

/// Of one round: a store with a short history, or with all of it and somebody who clears it.
struct Round {
    std::string path;
    bool keeps_all = false;
    bool clears = false;
    std::uint32_t max_frames = 0;
};

StampNs stamp_of(std::uint64_t number) {
    return kFirstStamp + static_cast<StampNs>(number) * kMilli;
}
/// What every sample of `late` says: its stamp, so that any of them is right by itself.
double late_number(StampNs stamp) {
    const StampNs micros = stamp / 1000;
    return static_cast<double>(micros) / 1000.0;
}

/// The names of one writer's frames.
struct Names {
    explicit Names(unsigned writer) : prefix("w" + std::to_string(writer) + "/") {
        for (unsigned i = 0; i < kJoints; ++i)
            joints[i] = prefix + "joint" + std::to_string(i);
    }
    [[nodiscard]] std::string comes(std::uint64_t number) const {
        return prefix + "comes" + std::to_string(number);
    }
    std::string prefix;
    std::array<std::string, kJoints> joints;
    std::string sum = prefix + "sum";
    std::string moves = prefix + "moves";
    std::string late = prefix + "late";
    std::string kind = prefix + "kind";
};

/// None: the edge has no sample, which only a clear may bring about.
std::optional<double> latest(const StoreReader& state, const std::string& target,
                             const std::string& source) {
    try {
        return number_of(state.lookup_latest_transform(target, source).pose);
    } catch (const Extrapolation&) {
        return std::nullopt;
    } catch (const Disconnected&) {
        return std::nullopt;
    }
}

/// The number of an arm in one state, judged to be the same in all of its edges; none if it was
/// cleared.
std::optional<std::uint64_t> judged_arm(const StoreReader& state, unsigned writer) {
    const Names names(writer);
    const std::optional<double> first = latest(state, "map", names.joints[0]);
    const auto same = [&](const char* what, const std::optional<double>& number,
                          const std::optional<double>& expected) {
        if (number != expected) {
            fail("writer %u, commit %llu: torn: %s says %f, not %f", writer,
                 static_cast<unsigned long long>(state.commit()), what, number.value_or(-1.0),
                 expected.value_or(-1.0));
        }
    };
    for (unsigned i = 1; i < kJoints; ++i)
        same("a joint", latest(state, names.joints[i - 1], names.joints[i]), first);
    same("the sum", latest(state, names.joints[kJoints - 1], names.sum),
         first ? std::optional(*first * kJoints) : std::nullopt);
    if (!first)
        return std::nullopt;
    const auto number = static_cast<std::uint64_t>(*first);
    const std::string& parent = names.joints[number % kJoints];
    const std::optional<std::string> found = state.parent_of(names.moves);
    if (found != parent)
        fail("writer %u: frame at the wrong parent %s", writer, found.value_or("(none)").c_str());
    same("who moves", latest(state, parent, names.moves), first);
    return number;
}

std::uint64_t judged_shared(const StoreReader& state) {
    const double one = latest(state, "map", "shared/one").value_or(-1.0);
    const double two = latest(state, "shared/one", "shared/two").value_or(-1.0);
    if (one < 0.0 || one != two)
        fail("torn: the shared arm says %f and %f", one, two);
    return static_cast<std::uint64_t>(std::max(one, 0.0));
}

void judge_late(const StoreReader& state, unsigned writer) {
    const Samples samples = state.samples(Names(writer).late);
    StampNs last = -1;
    for (std::size_t i = 0; i < samples.stamps.size(); ++i) {
        if (samples.stamps[i] <= last ||
            number_of(samples.poses[i]) != late_number(samples.stamps[i]))
            fail("writer %u: wrong late sample %zu of %zu", writer, i, samples.stamps.size());
        last = samples.stamps[i];
    }
}

// -- writers
// ---------------------------------------------------------------------------------------

class Writer {
public:
    Writer(const Round& round, unsigned index, std::uint64_t seed)
        : round_(round),
          index_(index),
          names_(index),
          notes_(g_board->writers[index]),
          random_(seed),
          death_(random_),
          buffer_(Buffer::open(round.path, true)) {}

    /// Until it is killed, or told to end.
    void run() {
        // Some die at their first call, which may have to repair.
        std::uint64_t calls = random_() % 3 == 0 ? 0 : random_() % 40;
        if (calls == 0)
            death_.arm();
        check_found();
        for (; g_board->ends.load_acquire() == 0; --calls) {
            if (calls == 0)
                death_.arm();
            step();
        }
    }

    /// What is in the store is what was done, or what was begun.
    void check_found() {
        const std::optional<std::uint64_t> arm = found_arm();
        const std::uint64_t done = notes_.done.load_acquire();
        const std::uint64_t begun = notes_.begun.load_acquire();
        if (arm ? *arm != done && *arm != begun : !may_be_cleared()) {
            fail("writer %u: lost or wrong: arm %llu, done %llu, begun %llu", index_,
                 static_cast<unsigned long long>(arm.value_or(0)),
                 static_cast<unsigned long long>(done), static_cast<unsigned long long>(begun));
        }
        notes_.done.store_release(arm.value_or(done));
        check_kind();
        check_late();
        check_frames();
        if (round_.clears)
            return;  // they may have no child at the moment
        try {
            buffer_.remove_frame(names_.joints[1], false);
            fail("writer %u: a frame with children was removed", index_);
        } catch (const FrameInUse&) {
        }
    }

    void set_up() {
        if (index_ == 0)
            set_shared(1);
        move_arm();
        change_kind();
        add_late();
    }

private:
    [[nodiscard]] std::optional<std::uint64_t> found_arm() const {
        for (;;) {
            try {
                return judged_arm(buffer_.snapshot(), index_);
            } catch (const SnapshotTooOld&) {
                // Somebody's death gave it up.
            }
        }
    }
    /// Whether a clear has not ended before this writer's arm was last stored.
    [[nodiscard]] bool may_be_cleared() const {
        return g_board->clears.load_acquire() > notes_.clears_before.load_acquire();
    }

    [[nodiscard]] TransformView edge(std::string_view parent, std::string_view child, StampNs stamp,
                                     double number) const {
        return {parent, child, stamp, pose_of(number)};
    }

    void step() {
        switch (notes_.begun.load_relaxed() % kOps) {
            case 1:
                add_late();
                break;
            case 2:
                make_frame();
                break;
            case 3:
                remove_frame();
                break;
            case 4:
                change_kind();
                break;
            case 5:
                move_shared();
                break;
            case 6:
                if (round_.clears && index_ == kWhoClears && random_() % 64 == 0)
                    clear();
                else if (index_ == 1 && random_() % 64 == 0)
                    buffer_.compact();
                break;
            case 7:
                if (random_() % 8 == 0)
                    hold();
                break;
            default:
                break;
        }
        move_arm();
    }

    /// One batch: every joint, the checksum, and a frame that hangs below another one each time.
    std::vector<TransformView> arm(std::uint64_t number) const {
        const auto value = static_cast<double>(number);
        std::vector<TransformView> batch;
        for (unsigned i = 0; i < kJoints; ++i) {
            batch.push_back(edge(i == 0 ? map_ : names_.joints[i - 1], names_.joints[i],
                                 stamp_of(number), value));
        }
        batch.push_back(
            edge(names_.joints[kJoints - 1], names_.sum, stamp_of(number), value * kJoints));
        batch.push_back(
            edge(names_.joints[number % kJoints], names_.moves, stamp_of(number), value));
        return batch;
    }
    template <class Store>
    void move_arm_with(Store store) {
        const std::uint64_t number = notes_.begun.load_relaxed() + 1;
        const std::uint64_t clears = g_board->clears_ended.load_acquire();
        const std::vector<TransformView> batch = arm(number);
        notes_.begun.store_release(number);
        store(batch);
        // Only this writer clears. After a commit of its own, none of its clears is left to come.
        if (index_ == kWhoClears)
            g_board->clears_ended.store_release(g_board->clears.load_acquire());
        notes_.clears_before.store_release(clears);
        notes_.done.store_release(number);
    }
    void move_arm() {
        move_arm_with(
            [&](const auto& batch) { buffer_.set_transforms(batch, false, names_.prefix); });
    }

    void set_shared(std::uint64_t number) {
        const std::array<TransformView, 2> batch = {
            edge(map_, "shared/one", 0, static_cast<double>(number)),
            edge("shared/one", "shared/two", 0, static_cast<double>(number))};
        buffer_.set_transforms(batch, true, "shared");
        raise_to(g_board->shared_done, number);
    }
    /// The arm of all writers, one further than it was, and this one's, in one transaction.
    void move_shared() {
        std::uint64_t number = 0;
        move_arm_with([&](const auto& batch) {
            while (!try_shared(batch, number)) {
            }
        });
        raise_to(g_board->shared_done, number);
    }

    bool try_shared(std::span<const TransformView> batch, std::uint64_t& number) {
        try {
            Transaction transaction(buffer_);
            const double now =
                number_of(transaction.lookup_latest_transform("map", "shared/one").pose);
            number = static_cast<std::uint64_t>(now) + 1;
            const std::array<TransformView, 2> both = {
                edge(map_, "shared/one", 0, static_cast<double>(number)),
                edge("shared/one", "shared/two", 0, static_cast<double>(number))};
            transaction.set_transforms(both, true, "shared");
            transaction.set_transforms(batch, false, names_.prefix);
            transaction.commit();
            return true;
        } catch (const Conflict&) {
            return false;
        }
    }

    /// Some samples in one batch, most of them out of order.
    void add_late() {
        const StampNs newest = stamp_of(notes_.begun.load_relaxed());
        std::set<StampNs> stamps;
        const std::size_t count = 1 + random_() % 6;
        while (stamps.size() < count)
            stamps.insert(newest - static_cast<StampNs>(random_() % 400) * 1000 * 1000);
        std::vector<TransformView> batch;
        for (const StampNs stamp : stamps)
            batch.push_back(edge(map_, names_.late, stamp, late_number(stamp)));
        std::shuffle(batch.begin(), batch.end(), random_);
        buffer_.set_transforms(batch, false, "late");
        for (const TransformView& done : batch) {
            const std::uint64_t at = notes_.late_at.load_relaxed();
            notes_.late[at % kRecent].store_release(static_cast<std::uint64_t>(done.stamp));
            notes_.late_at.store_release(at + 1);
        }
    }
    void check_late() {
        judge_late(buffer_, index_);
        if (round_.clears)
            return;
        const Samples samples = buffer_.samples(names_.late);
        for (const Word& word : notes_.late) {
            const auto stamp = static_cast<StampNs>(word.load_acquire());
            const bool is_old =
                samples.stamps.empty() || stamp == 0 ||
                (buffer_.history() && stamp < samples.stamps.back() - *buffer_.history());
            if (!is_old &&
                !std::binary_search(samples.stamps.begin(), samples.stamps.end(), stamp)) {
                fail("writer %u: the late sample at %lld is lost", index_,
                     static_cast<long long>(stamp));
            }
        }
    }

    void make_frame() {
        if (notes_.made.load_relaxed() != 0)
            remove_frame();
        const std::uint64_t number = notes_.begun.load_relaxed();
        buffer_.set_transform(edge(names_.sum, names_.comes(number), stamp_of(number), 1.0), false,
                              names_.comes(number % 50));
        notes_.made.store_release(number);
    }
    void remove_frame() {
        const std::uint64_t made = notes_.made.load_relaxed();
        if (made == 0)
            return;
        notes_.made.store_release(0);
        buffer_.remove_frame(names_.comes(made), false);
    }
    /// Those that are there beside the one that was made were being made, or removed.
    void check_frames() {
        const std::uint64_t made = notes_.made.load_acquire();
        bool found = made == 0;
        unsigned others = 0;
        for (const std::string& frame : buffer_.frames()) {
            if (!frame.starts_with(names_.prefix + "comes"))
                continue;
            const bool is_made = frame == names_.comes(made);
            found = found || is_made;
            others += is_made ? 0 : 1;
            if (!is_made)
                buffer_.remove_frame(frame, false);
        }
        if (!found)
            fail("writer %u: a frame that was made is gone", index_);
        if (others > 1)
            fail("writer %u: %u frames too many", index_, others);
    }

    /// Static, then moving, and so on: each drops what was there.
    void change_kind() {
        const std::uint64_t number = notes_.kind_begun.load_relaxed() + 1;
        notes_.kind_begun.store_release(number);
        buffer_.set_transform(
            edge(names_.sum, names_.kind, stamp_of(number), static_cast<double>(number)),
            number % 2 == 0, "kind", {.change_kind = true, .only_new = false});
        notes_.kind_done.store_release(number);
    }
    void check_kind() {
        const std::optional<double> found = latest(buffer_, names_.sum, names_.kind);
        const auto number = static_cast<std::uint64_t>(found.value_or(0.0));
        const std::uint64_t done = notes_.kind_done.load_acquire();
        const std::uint64_t begun = notes_.kind_begun.load_acquire();
        if (number != done && number != begun && !(round_.clears && !found)) {
            fail("writer %u: kind %llu, done %llu, begun %llu", index_,
                 static_cast<unsigned long long>(number), static_cast<unsigned long long>(done),
                 static_cast<unsigned long long>(begun));
        }
        notes_.kind_done.store_release(found ? number : done);
    }

    void clear() {
        g_board->clears.fetch_add(1);
        buffer_.clear();
    }

    /// A state that is held while its writer goes on stays what it was.
    void hold() {
        const Snapshot held = buffer_.snapshot();
        const std::optional<std::uint64_t> before = judged_arm(held, index_);
        for (int i = 0; i < 20; ++i)
            move_arm();
        try {
            if (judged_arm(held, index_) != before)
                fail("writer %u: a held state has changed", index_);
        } catch (const SnapshotTooOld&) {
            // Somebody's death gave it up.
        }
    }

    const Round& round_;
    unsigned index_;
    Names names_;
    WriterNotes& notes_;
    std::mt19937_64 random_;
    Death death_;
    Buffer buffer_;
    const std::string map_ = "map";
};

// -- readers
// ---------------------------------------------------------------------------------------

class Reader {
public:
    Reader(const Round& round, const Options& options, unsigned index, std::uint64_t seed)
        : round_(round),
          options_(options),
          notes_(g_board->readers[index]),
          random_(seed),
          buffer_(Buffer::open(round.path, false)) {}

    void run() {
        while (g_board->ends.load_acquire() == 0) {
            judge_fresh();
            try {
                judge_one_state();
            } catch (const SnapshotTooOld&) {
                // Somebody's death gave it up.
                notes_.too_old.fetch_add(1);
            }
            notes_.rounds.fetch_add(1);
        }
    }

private:
    /// Everything in one state, and nothing that was done before it was taken is missing there.
    void judge_one_state() {
        std::array<std::uint64_t, kMostWriters> done{};
        for (unsigned w = 0; w < options_.writers; ++w)
            done[w] = g_board->writers[w].done.load_acquire();
        const std::uint64_t shared = g_board->shared_done.load_acquire();
        const Snapshot state = buffer_.snapshot();
        if (state.commit() < commit_)
            fail("the commit went back");
        commit_ = state.commit();
        for (unsigned w = 0; w < options_.writers; ++w) {
            const std::optional<std::uint64_t> arm = judged_arm(state, w);
            if (!arm && !round_.clears)
                fail("the arm of writer %u is gone", w);
            if (arm && *arm < std::max(done[w], seen_[w])) {
                fail("the arm of writer %u went back from %llu to %llu", w,
                     static_cast<unsigned long long>(std::max(done[w], seen_[w])),
                     static_cast<unsigned long long>(*arm));
            }
            seen_[w] = arm.value_or(seen_[w]);
            if (arm && !round_.clears)
                judge_history(state, w, *arm);
            if (random_() % 8 == 0)
                judge_late(state, w);
            notes_.answers.fetch_add(8);
        }
        const std::uint64_t now = judged_shared(state);
        if (now < std::max(shared, seen_shared_))
            fail("the shared arm went back");
        seen_shared_ = now;
        if (random_() % 4 == 0)
            judge_tree(state);
    }

    /// Where the arm was some time ago, by a single lookup and by a batch.
    void judge_history(const Snapshot& state, unsigned writer, std::uint64_t number) {
        const Names names(writer);
        const std::uint64_t back = std::min<std::uint64_t>(number - 1, random_() % 200);
        std::vector<StampNs> stamps;
        for (std::uint64_t n = number - back; n <= number; ++n)
            stamps.push_back(stamp_of(n));
        std::vector<double> rows(7 * stamps.size());
        state.lookup_many("map", names.joints[0], stamps, {}, Layout::kPose, Missing::kThrow, rows);
        const Pose first = state.lookup_transform("map", names.joints[0], stamps.front()).pose;
        const double expected = static_cast<double>(number - back);
        // A number that was begun and not done lies between its neighbours.
        if (std::abs(rows[0] - expected) > 1e-6 || rows[0] != first.translation.x)
            fail("writer %u: %f in the past, not %f", writer, rows[0], expected);
        if (rows[7 * (stamps.size() - 1)] != static_cast<double>(number))
            fail("writer %u: the batch's newest row is wrong", writer);
    }

    void judge_tree(const Snapshot& state) {
        const std::vector<FrameInfo> tree = state.tree();
        std::set<std::string> names;
        for (const FrameInfo& frame : tree) {
            if (!names.insert(frame.name).second)
                fail("two frames %s", frame.name.c_str());
        }
        for (const FrameInfo& frame : tree) {
            if (frame.parent && !names.contains(*frame.parent))
                fail("%s has a parent that is none", frame.name.c_str());
        }
        if (tree.size() != state.frames().size())
            fail("the tree and the list of frames differ");
        notes_.answers.fetch_add(2);
    }

    /// Single reads, each of a state of its own.
    void judge_fresh() {
        for (unsigned w = 0; w < options_.writers; ++w) {
            const std::uint64_t done = g_board->writers[w].done.load_acquire();
            const std::optional<double> found = latest(buffer_, "map", Names(w).joints[0]);
            if (found ? *found < static_cast<double>(std::max(done, seen_[w])) : !round_.clears)
                fail("writer %u: %f came after %llu", w, found.value_or(-1.0),
                     static_cast<unsigned long long>(std::max(done, seen_[w])));
            if (found)
                seen_[w] = static_cast<std::uint64_t>(*found);
            notes_.answers.fetch_add(1);
        }
    }

    const Round& round_;
    const Options& options_;
    ReaderNotes& notes_;
    std::mt19937_64 random_;
    Buffer buffer_;
    CommitNumber commit_ = 0;
    std::array<std::uint64_t, kMostWriters> seen_{};
    std::uint64_t seen_shared_ = 0;
};

// -- one round
// -------------------------------------------------------------------------------------

/// A child that ends with its parent. Its work may throw.
template <class Work>
pid_t start(Work work) {
    std::fflush(nullptr);
    const pid_t child = ::fork();
    if (child != 0)
        return child;
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    try {
        work();
    } catch (const std::exception& error) {
        fail("a process ended with: %s", error.what());
    }
    ::_exit(0);
}

std::uint64_t blocks_of(const std::string& path) {
    struct stat status {};
    ::stat(path.c_str(), &status);
    return static_cast<std::uint64_t>(status.st_blocks) * 512;
}

struct Totals {
    std::uint64_t kills = 0;
    std::uint64_t repairs = 0;
    std::uint64_t commits = 0;
    std::uint64_t answers = 0;
    std::uint64_t too_old = 0;
};

/// Writers are killed and started again, beside readers. Threads: one. Guarantee: as its
/// processes'.
class Storm {
public:
    Storm(const Round& round, const Options& options, std::uint64_t seed, Totals& totals)
        : round_(round), options_(options), random_(seed), totals_(totals) {
        BufferOptions store;
        store.max_frames = round.max_frames;
        if (round.keeps_all)
            store.history_ns = std::nullopt;
        else
            store.history_ns = clock::kNanosPerSecond;
        ShareOptions share;
        share.size = 256 * kMebi;
        Buffer::create(round.path, share, store);
        new (g_board) Board{};
        buffer_ = std::make_unique<Buffer>(Buffer::open(round.path, true));
    }
    ~Storm() { Buffer::unlink(round_.path); }
    Storm(const Storm&) = delete;
    Storm& operator=(const Storm&) = delete;

    void run(unsigned kills) {
        for (unsigned w = 0; w < options_.writers; ++w)
            Writer(round_, w, random_()).set_up();
        for (unsigned w = 0; w < options_.writers; ++w)
            start_writer(w);
        for (unsigned r = 0; r < options_.readers; ++r) {
            readers_.push_back(
                start([&, r, seed = random_()] { Reader(round_, options_, r, seed).run(); }));
        }
        std::uint64_t used = 0;
        std::uint64_t blocks = 0;
        for (unsigned killed = 0; killed < kills && g_board->failures.load_acquire() == 0;) {
            killed += one_death();
            if (killed >= kills / 2 && used == 0) {
                used = use();
                blocks = blocks_of(round_.path);
            }
            if (random_() % 64 == 0)
                stop_writers();
        }
        end_all();
        check_memory(used, blocks);
        check_end();
    }

private:
    void start_writer(unsigned w) {
        writers_[w] = start([&, w, seed = random_()] { Writer(round_, w, seed).run(); });
    }
    [[nodiscard]] static bool failed() { return g_board->failures.load_acquire() != 0; }

    /// Some writer dies; perhaps another one too, which may be repairing what it left.
    unsigned one_death() {
        ::alarm(kNoProgressSeconds);
        int status = 0;
        const pid_t dead = ::waitpid(-1, &status, 0);
        unsigned killed = note_death(dead, status);
        if (random_() % 3 == 0) {
            const pid_t next = writers_[random_() % options_.writers];
            ::kill(next, SIGKILL);
            ::waitpid(next, &status, 0);
            killed += note_death(next, status);
        }
        return killed;
    }
    unsigned note_death(pid_t dead, int status) {
        const auto found = std::find(writers_.begin(), writers_.end(), dead);
        if (found == writers_.end() || !WIFSIGNALED(status) || WTERMSIG(status) != SIGKILL) {
            fail("process %d ended with status %x", static_cast<int>(dead),
                 static_cast<unsigned>(status));
            return 0;
        }
        ++totals_.kills;
        start_writer(static_cast<unsigned>(found - writers_.begin()));
        return 1;
    }

    /// Readers go on while all writers are stopped, wherever they are.
    void stop_writers() {
        for (unsigned w = 0; w < options_.writers; ++w)
            ::kill(writers_[w], SIGSTOP);
        for (unsigned r = 0; r < options_.readers; ++r) {
            const Word& rounds = g_board->readers[r].rounds;
            const std::uint64_t until = rounds.load_acquire() + 3;
            while (rounds.load_acquire() < until && !failed())
                ::sched_yield();
        }
        for (unsigned w = 0; w < options_.writers; ++w)
            ::kill(writers_[w], SIGCONT);
    }

    void end_all() {
        ::alarm(kNoProgressSeconds);
        g_board->ends.store_release(1);
        for (unsigned w = 0; w < options_.writers; ++w)
            ::waitpid(writers_[w], nullptr, 0);
        for (const pid_t reader : readers_) {
            int status = 0;
            ::waitpid(reader, &status, 0);
            if (!WIFEXITED(status))
                fail("a reader ended with status %x", static_cast<unsigned>(status));
        }
        totals_.commits += buffer_->commit();
        totals_.repairs += buffer_->shared()->repairs;
        for (unsigned r = 0; r < options_.readers; ++r) {
            totals_.answers += g_board->readers[r].answers.load_acquire();
            totals_.too_old += g_board->readers[r].too_old.load_acquire();
        }
    }

    [[nodiscard]] std::uint64_t use() const { return buffer_->memory().used_bytes; }

    void check_memory(std::uint64_t used, std::uint64_t blocks) {
        // Blocks that deaths leave are swept from time to time; until then they are few.
        if (!round_.keeps_all &&
            (use() > 2 * used + 4 * kMebi || blocks_of(round_.path) > 2 * blocks + 4 * kMebi)) {
            fail("memory grew from %llu (file %llu) to %llu (file %llu)",
                 static_cast<unsigned long long>(used), static_cast<unsigned long long>(blocks),
                 static_cast<unsigned long long>(use()),
                 static_cast<unsigned long long>(blocks_of(round_.path)));
        }
        if (buffer_->shared()->processes != 1)
            fail("%llu processes still count",
                 static_cast<unsigned long long>(buffer_->shared()->processes));
    }

    void check_end() {
        for (unsigned w = 0; w < options_.writers; ++w)
            Writer(round_, w, 0).check_found();
        if (judged_shared(*buffer_) < g_board->shared_done.load_acquire())
            fail("the shared arm is older than what was done");
        fill_frames();
        take_apart();
    }
    /// Whatever died, every slot is there for a frame.
    void fill_frames() {
        std::size_t frames = buffer_->frames().size();
        try {
            for (;; ++frames) {
                const std::string name = "fill" + std::to_string(frames);
                buffer_->set_transform({"map", name, 1, pose_of(1.0)}, true, "fill");
            }
        } catch (const CapacityExceeded&) {
        }
        if (frames != round_.max_frames)
            fail("%zu frames fit, not %u", frames, round_.max_frames);
    }
    /// Frames with children are refused, those without are not, down to the last one.
    void take_apart() {
        for (std::vector<FrameInfo> tree = buffer_->tree(); !tree.empty(); tree = buffer_->tree()) {
            std::set<std::string> parents;
            for (const FrameInfo& frame : tree)
                parents.insert(frame.parent.value_or(""));
            // Those with children first: the others are gone then.
            std::stable_partition(tree.begin(), tree.end(), [&](const FrameInfo& frame) {
                return parents.contains(frame.name);
            });
            for (const FrameInfo& frame : tree) {
                const bool has_children = parents.contains(frame.name);
                try {
                    buffer_->remove_frame(frame.name, false);
                    if (has_children)
                        return fail("%s was removed and has children", frame.name.c_str());
                } catch (const FrameInUse&) {
                    if (!has_children)
                        return fail("%s cannot be removed", frame.name.c_str());
                }
            }
        }
    }

    const Round& round_;
    const Options& options_;
    std::mt19937_64 random_;
    Totals& totals_;
    std::unique_ptr<Buffer> buffer_;
    std::array<pid_t, kMostWriters> writers_{};
    std::vector<pid_t> readers_;
};

std::int64_t now_ns() {
    timespec now{};
    ::clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1'000'000'000 + now.tv_nsec;
}

void print(const Totals& totals, double seconds) {
    std::printf(
        "%llu kills in %.0f s: %llu repairs, %llu commits, %llu answers judged, %llu held "
        "states given up, %llu failures\n",
        static_cast<unsigned long long>(totals.kills), seconds,
        static_cast<unsigned long long>(totals.repairs),
        static_cast<unsigned long long>(totals.commits),
        static_cast<unsigned long long>(totals.answers),
        static_cast<unsigned long long>(totals.too_old),
        static_cast<unsigned long long>(g_board->failures.load_acquire()));
    std::fflush(stdout);
}

bool torture(const Options& options) {
    void* const page =
        ::mmap(nullptr, sizeof(Board), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (page == MAP_FAILED)
        return false;
    g_board = new (page) Board{};
    const std::int64_t begun = now_ns();
    const auto seconds = [&] { return static_cast<double>(now_ns() - begun) * 1e-9; };
    Totals totals;
    for (unsigned r = 0; seconds() < options.seconds || r < 3; ++r) {
        const Round round{.path = "/dev/shm/tfdb-torture-" + std::to_string(::getpid()),
                          .keeps_all = r % 3 == 1,
                          .clears = r % 3 == 2,
                          .max_frames = 2 + 1 + 12 * options.writers};
        Storm(round, options, options.seed * 1000003 + r, totals).run(300);
        if (g_board->failures.load_acquire() != 0)
            break;
    }
    print(totals, seconds());
    return g_board->failures.load_acquire() == 0;
}

void no_progress(int) {
    static constexpr char kText[] = "FAILED: no process was killed for a minute: one hangs\n";
    (void)!::write(STDERR_FILENO, kText, sizeof kText - 1);
    ::_exit(1);
}

}  // namespace

#ifdef TFDB_COUNTS_STORES
void sync::about_to_store() noexcept {
    if (g_stores_left != 0 && --g_stores_left == 0)
        ::kill(::getpid(), SIGKILL);
}
#endif

}  // namespace tfdb

int main(int argc, char** argv) {
    tfdb::Options options;
    tfdb::testing::read_options(argc, argv,
                                {{"--seconds", options.seconds},
                                 {"--seed", options.seed},
                                 {"--writers", options.writers},
                                 {"--readers", options.readers}});
    options.writers = std::min(options.writers, tfdb::kMostWriters);
    options.readers = std::min(options.readers, tfdb::kMostReaders);
    std::signal(SIGALRM, tfdb::no_progress);
    std::printf("seed %u, %u writers, %u readers\n", options.seed, options.writers,
                options.readers);
    return tfdb::torture(options) ? 0 : 1;
}
