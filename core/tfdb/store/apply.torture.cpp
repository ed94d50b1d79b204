// A copy in a shared store is killed while it applies the commits of another store, or forgets it:
// its state is always that of its position, and it goes on from there.
//
//   torture_store_apply [--seconds 20] [--seed 1]
//
// Built with TFDB_COUNTS_STORES, it dies before each single store to shared memory of each sample.
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <map>
#include <optional>
#include <random>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "tfdb/store/buffer.hpp"
#include "tfdb/store/fixture.hpp"
#include "tfdb/sync/word.hpp"
#include "tfdb/testing/options.hpp"

namespace tfdb {
namespace {

using fixture::pose_of;
using Bytes = std::vector<std::byte>;

#ifdef TFDB_COUNTS_STORES
std::uint64_t g_stores_left = 0;
#endif

constexpr StampNs kHistory = 60;
constexpr unsigned kFrames = 6;
constexpr unsigned kCommits = 40;
constexpr std::array<std::string_view, 3> kChosen = {"frame0", "frame1", "frame2"};

BufferOptions options() {
    BufferOptions made;
    made.history_ns = kHistory;
    made.max_frames = 64;
    return made;
}

std::string name_of(std::uint64_t i) {
    return "frame" + std::to_string(i % kFrames);
}

/// A store's life, commit by commit: what it sent, and what it was like after each.
/// Threads: one. Guarantee: the same seed makes the same life.
class Life {
public:
    explicit Life(unsigned seed) : random_(seed), source_(options()) {
        const Snapshot held = source_.snapshot();
        Buffer judge(options());
        push(judge);
        while (source_.commit() < kCommits) {
            const CommitNumber before = source_.commit();
            act();
            if (source_.commit() == before)
                continue;
            judge.apply(source_.commits_bytes(before, {.commits = 1}));
            push(judge);
            send(before);
        }
    }

    /// Everything that a reader sees, in bits; frames of others are left out, and those that were
    /// not chosen. The last writers' names may lack those of the newest commit until a dead
    /// writer's work is repaired.
    static std::string picture(const Buffer& buffer, bool some, bool with_writers) {
        std::string text;
        for (const FrameInfo& info : buffer.tree()) {
            const bool is_chosen =
                std::find(kChosen.begin(), kChosen.end(), info.name) != kChosen.end();
            if (some ? !is_chosen : info.name.starts_with("other"))
                continue;
            text += "\n" + info.name + " " + info.parent.value_or("-") + " " +
                    (with_writers ? info.authority : "") + (info.is_static ? " static" : "");
            const Samples samples = buffer.samples(info.name);
            for (std::size_t i = 0; i < samples.poses.size(); ++i) {
                text += " " + samples.parents[i] + std::to_string(samples.stamps[i]);
                text.append(reinterpret_cast<const char*>(&samples.poses[i]), sizeof(Pose));
            }
        }
        return text;
    }
    /// What a copy with some frames, or all, must be like after a commit.
    [[nodiscard]] const std::string& state(CommitNumber commit, bool some,
                                           bool with_writers) const {
        return states_[commit].at({some, with_writers});
    }

    /// In an order in which they can be applied; an empty one: the source is forgotten.
    std::vector<Bytes> samples;

private:
    void push(const Buffer& judge) {
        auto& states = states_.emplace_back();
        for (const bool some : {false, true}) {
            for (const bool with_writers : {false, true})
                states[{some, with_writers}] = picture(judge, some, with_writers);
        }
    }
    void send(CommitNumber before) {
        switch (random_() % 10) {
            case 0:
                samples.emplace_back();
                send_state();
                break;
            case 1:  // other frames
                some_ = !some_;
                send_state();
                break;
            case 2:  // and others at the same commit
                send_state();
                some_ = !some_;
                send_state();
                break;
            default: {
                const bool twice = random_() % 3 == 0 && before >= 3;
                samples.push_back(source_.commits_bytes(before - (twice ? 3 : 0), {}, only()));
            }
        }
    }
    void send_state() { samples.push_back(source_.snapshot().state_bytes(only())); }
    [[nodiscard]] std::optional<std::span<const std::string_view>> only() const {
        return some_ ? std::optional(std::span(kChosen)) : std::nullopt;
    }
    void act() {
        clock_ += static_cast<StampNs>(random_() % 6);
        try {
            switch (random_() % 8) {
                case 0:
                    source_.clear();
                    break;
                case 1:
                    source_.remove_frame(name_of(random_()), random_() % 2 == 0);
                    break;
                default:
                    write(random_() % 4 == 0);
            }
        } catch (const Error&) {
            ++refused_;
        }
    }
    void write(bool is_static) {
        std::vector<std::string> names;
        const std::uint64_t first = random_();
        for (std::uint64_t i = 0; i < 6; ++i)
            names.push_back(name_of(i % 2 == 0 ? first + i / 2 : random_()));
        std::vector<TransformView> batch;
        for (std::uint64_t i = 0; i < 1 + first % 3; ++i) {
            const auto late = static_cast<StampNs>(random_() % 4 == 0 ? random_() % 30 : 0);
            batch.push_back({names[2 * i + 1], names[2 * i], 100 + clock_ - late,
                             pose_of(static_cast<double>(++number_))});
        }
        source_.set_transforms(batch, is_static, number_ % 2 == 0 ? "even" : "odd",
                               {.change_kind = true});
    }

    std::mt19937_64 random_;
    Buffer source_;
    std::vector<std::map<std::array<bool, 2>, std::string>> states_;  // by commits
    bool some_ = false;  // what is sent: not all frames
    StampNs clock_ = 0;
    std::uint64_t number_ = 0;
    std::uint64_t refused_ = 0;
};

/// The copy, in a store of its own for each death.
/// Threads: one. Guarantee: none.
class Copy {
public:
    explicit Copy(unsigned seed)
        : path_("/dev/shm/tfdb-torture-apply-" + std::to_string(::getpid())),
          life_(seed),
          random_(seed) {}

    /// Lets the copy die once while it applies sample `at`. False: it lived, or a fault was found.
    bool die_once(std::size_t at, std::uint64_t stores) {
        Buffer::create(path_, {.size = std::size_t{16} << 20}, options());
        const bool died = judge(at, stores);
        Buffer::unlink(path_);
        return died && failures == 0;
    }

    [[nodiscard]] std::size_t samples() const { return life_.samples.size(); }
    [[nodiscard]] bool forgets(std::size_t at) const { return life_.samples[at].empty(); }
    unsigned failures = 0;

private:
    bool judge(std::size_t at, std::uint64_t stores) {
        Buffer copy = Buffer::open(path_, true);
        Applier applier(copy, {});
        last_ = {};
        for (std::size_t i = 0; i < at; ++i)
            take(copy, applier, life_.samples[i]);
        const bool died = kill_one(at, stores);
        const std::vector<Position> positions = look(copy, false, "after the death");
        // The next writer takes back what was not committed, and takes the commit's number.
        fixture::set_static(copy, "other", "others", pose_of(7));
        if (look(copy, true, "after the repair") != positions)
            fail(at, stores, "the repair moved the position");
        for (std::size_t i = at; i < life_.samples.size(); ++i)
            take(copy, applier, life_.samples[i]);
        (void)look(copy, true, "at the end");
        if (last_.commit != kCommits)
            fail(at, stores, "the copy did not come to the end");
        return died;
    }
    void take(Buffer& copy, Applier& applier, const Bytes& sample) {
        if (sample.empty())
            copy.forget_source("");
        else
            last_ = applier.apply(sample);
    }
    std::vector<Position> look(const Buffer& copy, bool with_writers, const char* when) {
        const std::vector<Position> positions = copy.positions();
        // One that was forgotten leaves the frames as they are.
        if (!positions.empty())
            last_ = positions[0];
        const bool some = last_.choice != 0;
        if (last_.commit > kCommits || Life::picture(copy, some, with_writers) !=
                                           life_.state(last_.commit, some, with_writers)) {
            std::fprintf(stderr, "FAILED: %s the state is not that of commit %llu\n", when,
                         static_cast<unsigned long long>(last_.commit));
            ++failures;
        }
        return positions;
    }
    void fail(std::size_t at, std::uint64_t stores, const char* what) {
        std::fprintf(stderr, "FAILED: sample %zu, store %llu: %s\n", at,
                     static_cast<unsigned long long>(stores), what);
        ++failures;
    }

    bool kill_one(std::size_t at, [[maybe_unused]] std::uint64_t stores) {
        std::fflush(nullptr);
        const pid_t child = ::fork();
        if (child == 0) {
            ::prctl(PR_SET_PDEATHSIG, SIGKILL);
            Buffer copy = Buffer::open(path_, true);
#ifdef TFDB_COUNTS_STORES
            g_stores_left = stores;
#endif
            Applier applier(copy, {});
            take(copy, applier, life_.samples[at]);
            ::_exit(0);
        }
#ifndef TFDB_COUNTS_STORES
        const auto until =
            std::chrono::steady_clock::now() + std::chrono::microseconds(random_() % 600);
        while (std::chrono::steady_clock::now() < until) {
        }
        ::kill(child, SIGKILL);
#endif
        int status = 0;
        ::waitpid(child, &status, 0);
        return WIFSIGNALED(status);
    }

    std::string path_;
    Life life_;
    Position last_;  // that was seen
    std::mt19937_64 random_;
};

double seconds_since(std::chrono::steady_clock::time_point begun) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
}

/// False: a fault was found.
bool torture(unsigned seconds, unsigned seed) {
    const auto begun = std::chrono::steady_clock::now();
    std::uint64_t deaths = 0;
    std::uint64_t forgetting = 0;
    unsigned rounds = 0;
    for (; rounds == 0 || seconds_since(begun) < seconds; ++rounds) {
        Copy copy(seed + rounds);
        for (std::size_t at = 0; at < copy.samples() && seconds_since(begun) < seconds; ++at) {
            const std::uint64_t before = deaths;
#ifdef TFDB_COUNTS_STORES
            for (std::uint64_t stores = 1; copy.die_once(at, stores); ++stores)
                ++deaths;
#else
            for (int times = 0; times < 5; ++times)
                deaths += copy.die_once(at, 0) ? 1 : 0;
#endif
            if (copy.failures != 0)
                return false;
            forgetting += copy.forgets(at) ? deaths - before : 0;
        }
    }
    std::printf("%llu deaths of copies, %llu that forgot, in %u lives, %.1f s\n",
                static_cast<unsigned long long>(deaths),
                static_cast<unsigned long long>(forgetting), rounds, seconds_since(begun));
    return deaths > 0;
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
    unsigned seconds = 20;
    unsigned seed = 1;
    tfdb::testing::read_options(argc, argv, {{"--seconds", seconds}, {"--seed", seed}});
    std::printf("seed %u\n", seed);
    return tfdb::torture(seconds, seed) ? 0 : 1;
}
