// Files of shared stores with words that were changed at random, before they are opened or while
// they are read: a process that reads everything gets answers or typed errors, and ends. So does
// one that opens it for writing, even after a writer's death, when the damaged store is repaired.
//
//   torture_store_damage [--seconds 20] [--seed 1]
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/graph/frames.hpp"
#include "tfdb/memory/region.hpp"
#include "tfdb/store/buffer.hpp"
#include "tfdb/store/fixture.hpp"
#include "tfdb/store/store.hpp"
#include "tfdb/testing/options.hpp"
#include "tfdb/testing/sanitized.hpp"

namespace tfdb {
namespace {

constexpr std::size_t kBytes = std::size_t{16} << 20;
constexpr std::uint32_t kFrames = 200;
constexpr unsigned kMostSeconds = 60;  // of the clock: nothing waits for long
constexpr int kRounds = 3;             // of reading while it is damaged
constexpr rlim_t kMostCpuSeconds = testing::kSanitized ? 50 : 10;
// A sanitizer has its own, and ends the process where it says so.
constexpr rlim_t kMostAddresses = testing::kSanitized ? RLIM_INFINITY : rlim_t{8} << 30;

/// What a child does. A writing child may find that another one died.
enum class Role : std::uint8_t { kReads, kReadsOn, kWrites, kRepairs };
constexpr std::array<const char*, 4> kRoles = {"reads", "reads on", "writes", "repairs"};

const std::array<std::string, 7> kKnown = {"map", "odom", "base", "moves", "late", "beam", "none"};

void set(Buffer& buffer, const std::string& parent, const std::string& child, StampNs stamp,
         double number, bool is_static = false) {
    buffer.set_transform({parent, child, stamp, fixture::pose_of(number)}, is_static, child);
}

/// Something of everything: long edges, several parents, late samples, frames that went, clears.
void fill(Buffer& buffer, bool cleared) {
    for (int i = 1; i < 2500; ++i) {
        const StampNs stamp = i * 1000;
        set(buffer, "map", "odom", stamp, i);
        if (i % 3 == 0)
            set(buffer, "odom", "base", stamp, i);
        if (i % 7 == 0)
            set(buffer, i % 2 == 0 ? "base" : "odom", "moves", stamp, i);
        if (i % 5 == 0)
            set(buffer, "base", "late", (i - i % 50) * 1000 + i * 37 % 50, i);
        if (i % 400 == 0)
            set(buffer, "base", "comes" + std::to_string(i), stamp, i);
    }
    set(buffer, "base", "lidar", 0, 3, true);
    set(buffer, "lidar", "beam", 0, 4, true);
    buffer.remove_frame("comes400", false);
    if (!cleared)
        return;
    buffer.clear();
    for (int i = 1; i < 700; ++i) {
        set(buffer, "map", "odom", i * 1000, i);
        set(buffer, "odom", "base", i * 1000, i);
    }
}

template <class Read>
void tried(Read read) {
    try {
        read();
    } catch (const Error&) {
        // Any typed error will do.
    }
}

void read_all(const StoreReader& state) {
    const lookup::Policy nearest{lookup::PolicyKind::kNearest, lookup::kNoLimit};
    std::vector<StampNs> stamps;
    for (StampNs stamp = 0; stamp < 2'500'000; stamp += 60'123)
        stamps.push_back(stamp);
    std::vector<double> rows(7 * stamps.size());
    tried([&] { (void)state.frames(); });
    tried([&] { (void)state.tree(); });
    tried([&] { (void)state.tree(1'000'000); });
    for (const std::string& from : kKnown) {
        tried([&] { (void)state.frame_info(from); });
        tried([&] { (void)state.samples(from); });
        tried([&] { (void)state.parent_of(from); });
        for (const std::string& to : kKnown) {
            tried([&] { (void)state.lookup_latest_transform(to, from); });
            tried([&] { (void)state.lookup_transform(to, from); });
            for (const StampNs stamp : {500'500, 2'499'000})
                tried([&] { (void)state.lookup_transform(to, from, stamp); });
            tried([&] { (void)state.lookup_transform(to, from, 1'234'567, nearest); });
            tried([&] { (void)state.lookup_transform_full(to, 1000, from, 200'000, "map"); });
            tried([&] { (void)state.common_times(to, from); });
            tried([&] { (void)state.path_stamps(to, from, std::nullopt, std::nullopt); });
            tried([&] {
                state.lookup_many(to, from, stamps, {}, Layout::kPose, Missing::kNan, rows);
            });
        }
    }
}

/// All that changes a store, some of it for frames that are new.
void write_all(Buffer& buffer) {
    for (int round = 0; round < 3; ++round) {
        const StampNs later = 3'000'000 + round * 50'000;
        for (int i = 0; i < 300; ++i)
            tried([&] { set(buffer, "map", "odom", later + i, i); });
        tried([&] { set(buffer, "odom", "base", later, 5); });
        tried([&] { set(buffer, round == 1 ? "odom" : "base", "moves", later, 6); });
        for (const StampNs late : {1'000'500, 7, 2'400'100})
            tried([&] { set(buffer, "base", "late", late, 7); });
        tried([&] { set(buffer, "base", "new" + std::to_string(round), later, 8); });
        tried([&] { (void)buffer.remove_frame("comes800", false); });
        tried([&] { (void)buffer.compact(); });
        tried([&] { (void)buffer.remove_frame("base", true); });
        tried([&] {
            std::vector<TransformView> batch;
            for (const std::string& child : kKnown)
                batch.push_back({"other", child, later + 70, fixture::pose_of(2)});
            (void)buffer.set_transforms(batch, false, "all");
        });
        tried([&] { (void)buffer.clear(); });
        tried([&] { (void)buffer.shared(); });
    }
}

/// What a child ended with: 0 all done, 1 refused.
int work_on(const std::string& path, Role role) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    const rlimit cpu{kMostCpuSeconds, kMostCpuSeconds};
    ::setrlimit(RLIMIT_CPU, &cpu);
    const rlimit addresses{kMostAddresses, kMostAddresses};
    ::setrlimit(RLIMIT_AS, &addresses);
    ::alarm(kMostSeconds);
    try {
        const bool writes = role == Role::kWrites || role == Role::kRepairs;
        constexpr std::int64_t kLockTimeoutNs = 100'000'000;
        Buffer buffer = Buffer::open(path, writes, kLockTimeoutNs);
        if (writes)
            write_all(buffer);
        for (int left = role == Role::kReadsOn ? kRounds : 1; left > 0; --left) {
            read_all(buffer);
            tried([&] { read_all(buffer.snapshot()); });
            tried([&] { (void)buffer.memory(); });
            const CommitNumber newest = buffer.commit();
            tried([&] { (void)buffer.changes(newest - std::min<CommitNumber>(newest, 100)); });
        }
        return 0;
    } catch (const Error&) {
        return 1;
    } catch (const std::bad_alloc&) {
        return 0;  // it said how much memory it would take: no harm
    }
}

/// A file, mapped as a whole, that can be put back to what it was.
/// Threads: one. Guarantee: none.
class Damaged {
public:
    explicit Damaged(const std::string& path) {
        const int file = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
        struct stat status {};
        ::fstat(file, &status);
        count_ = static_cast<std::size_t>(status.st_size) / 8;
        words_ = static_cast<std::uint64_t*>(
            ::mmap(nullptr, 8 * count_, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0));
        ::close(file);
        was_.assign(words_, words_ + count_);
    }
    ~Damaged() { ::munmap(words_, 8 * count_); }
    Damaged(const Damaged&) = delete;
    Damaged& operator=(const Damaged&) = delete;

    [[nodiscard]] std::size_t count() const { return count_; }
    [[nodiscard]] std::uint64_t word(std::size_t at) const { return words_[at]; }
    void store(std::size_t at, std::uint64_t value) {
        changed_.emplace_back(at, value);
        __atomic_store_n(words_ + at, value, __ATOMIC_RELAXED);
    }
    /// As it was, whichever child wrote it.
    void mend() {
        std::memcpy(words_, was_.data(), 8 * count_);
        changed_.clear();
    }
    [[nodiscard]] std::string changes() const {
        std::string text;
        const std::size_t told = std::min<std::size_t>(changed_.size(), 40);
        for (std::size_t i = changed_.size() - told; i < changed_.size(); ++i) {
            const auto& [at, value] = changed_[i];
            std::array<char, 96> line{};
            std::snprintf(line.data(), line.size(), " word %zu: %llx -> %llx;", at,
                          static_cast<unsigned long long>(was_[at]),
                          static_cast<unsigned long long>(value));
            text += line.data();
        }
        return text;
    }

private:
    std::uint64_t* words_ = nullptr;
    std::size_t count_ = 0;
    std::vector<std::uint64_t> was_;
    std::vector<std::pair<std::size_t, std::uint64_t>> changed_;
};

/// A store, and which of its words lead anywhere.
class Victim {
public:
    Victim(const std::string& path, bool cleared) : path_(path) {
        BufferOptions options;
        options.max_frames = kFrames;
        options.history_ns = std::nullopt;
        ShareOptions share;
        share.size = kBytes;
        Buffer::create(path, share, options);
        {
            Buffer buffer = Buffer::open(path, true);
            fill(buffer, cleared);
        }
        data_.emplace(path);
        std::array<char, 32> id{};
        std::snprintf(id.data(), id.size(), ".control-%016llx",
                      static_cast<unsigned long long>(data_->word(10)));
        control_.emplace(path + id.data());
        const std::size_t root = memory::Region::root() / 8;
        const std::size_t table = data_->word(root + graph::kFrameTable) / 8;
        const std::size_t behind = table + graph::Frames<memory::Region>::bytes(kFrames) / 8;
        for (std::size_t i = 0; i < data_->count(); ++i) {
            if (data_->word(i) != 0)
                filled_.push_back(i);
            const bool leads = i < root || (i >= table && i < behind);
            const bool is_header = i < 40 || (i >= root && i < root + graph::kStoreWords);
            if (is_header || (leads && data_->word(i) != 0))
                leading_.push_back(i);
        }
    }
    ~Victim() { Buffer::unlink(path_); }
    Victim(const Victim&) = delete;
    Victim& operator=(const Victim&) = delete;

    /// Changes up to three words, most of them among those that lead somewhere; the lock and what
    /// is beside it now and then.
    void damage(std::mt19937_64& random) {
        for (std::uint64_t left = 1 + random() % 3; left > 0; --left) {
            if (random() % 8 == 0) {
                constexpr std::size_t kUsed = (4096 + 2 * 8 * memory::Control::kSlotWords) / 8;
                // The mutex and the words before it; few others are ever looked at.
                const std::size_t at = random() % (random() % 2 == 0 ? 40 : kUsed);
                control_->store(at, other(control_->word(at), random));
                continue;
            }
            const auto& from = random() % 5 != 0 ? leading_ : filled_;
            const std::size_t at = from[random() % from.size()];
            data_->store(at, other(data_->word(at), random));
        }
    }
    /// A writer dies with the lock in its hands, and the allocator's too.
    void die(std::mt19937_64& random) {
        const pid_t child = ::fork();
        if (child == 0) {
            memory::SharedFile file = memory::open_shared(path_, true, store::Store::layout());
            (void)file.control->lock(0);
            ::_exit(0);
        }
        ::waitpid(child, nullptr, 0);
        data_->store(4, 1);  // Region's lock
        // Some frames look as if the dead one had changed them.
        const std::size_t root = memory::Region::root() / 8;
        const std::size_t table = data_->word(root + graph::kFrameTable) / 8;
        const std::uint64_t next = data_->word(root + graph::kCommit) + 1;
        for (int left = 3; left > 0; --left) {
            constexpr std::array kNumbers = {history::kChanged, history::kReshaped, history::kSince,
                                             history::kDied};
            const std::size_t frame = random() % 12;
            data_->store(table + frame * history::kHeaderWords + kNumbers[random() % 4], next);
        }
    }
    void mend() {
        data_->mend();
        control_->mend();
    }
    [[nodiscard]] std::string damages() const {
        return data_->changes() + " control:" + control_->changes();
    }

private:
    [[nodiscard]] std::uint64_t other(std::uint64_t was, std::mt19937_64& random) const {
        switch (random() % 5) {
            case 0:
                return random();
            case 1:
                return ~std::uint64_t{0};
            case 2:
                return was + 64 * (random() % 3) + random() % 3 - 1;
            case 3:
                return data_->word(filled_[random() % filled_.size()]);
            default:
                return was ^ std::uint64_t{1} << random() % 64;
        }
    }

    std::string path_;
    std::optional<Damaged> data_;
    std::optional<Damaged> control_;
    std::vector<std::size_t> filled_;
    std::vector<std::size_t> leading_;
};

/// One child works on a store that is damaged, before it or meanwhile. Returns how it ended.
int run(Victim& victim, const std::string& path, Role role, std::mt19937_64& random) {
    if (role == Role::kRepairs)
        victim.die(random);
    if (role != Role::kReadsOn)
        victim.damage(random);
    const pid_t child = ::fork();
    if (child == 0)
        ::_exit(work_on(path, role));
    int status = 0;
    if (role == Role::kReadsOn) {
        while (::waitpid(child, &status, WNOHANG) == 0) {
            victim.damage(random);
            ::usleep(100);
        }
    } else {
        ::waitpid(child, &status, 0);
    }
    return status;
}

int torture(unsigned seconds, unsigned seed) {
    const std::string path = "/dev/shm/tfdb-damage-" + std::to_string(::getpid());
    std::array<unsigned, 3> counts{};  // done, refused, failed
    const std::time_t end = std::time(nullptr) + static_cast<std::time_t>(seconds);
    for (const bool cleared : {false, true}) {
        Victim victim(path, cleared);
        const std::time_t until = cleared ? end : end - static_cast<std::time_t>(seconds / 2);
        for (unsigned round = 0; std::time(nullptr) < until; ++round) {
            // Each by itself, so that one that failed can be had again.
            std::mt19937_64 random(seed + round);
            const auto role = static_cast<Role>(random() % kRoles.size());
            const int status = run(victim, path, role, random);
            const bool ended = WIFEXITED(status) && WEXITSTATUS(status) < 2;
            ++counts[ended ? static_cast<unsigned>(WEXITSTATUS(status)) : 2];
            if (!ended) {
                std::fprintf(stderr,
                             "FAILED: seed %u, %s: one that %s ended with status %x after%s\n",
                             seed + round, cleared ? "cleared" : "not cleared",
                             kRoles[static_cast<std::size_t>(role)], static_cast<unsigned>(status),
                             victim.damages().c_str());
            }
            victim.mend();
        }
    }
    std::printf("%u children of a damaged store did all, %u were refused, %u failed\n", counts[0],
                counts[1], counts[2]);
    return counts[2] == 0 ? 0 : 1;
}

}  // namespace

#ifdef TFDB_COUNTS_STORES
void sync::about_to_store() noexcept {}
#endif

}  // namespace tfdb

int main(int argc, char** argv) {
    unsigned seconds = 20;
    unsigned seed = 1;
    tfdb::testing::read_options(argc, argv, {{"--seconds", seconds}, {"--seed", seed}});
    std::printf("seed %u\n", seed);
    return tfdb::torture(seconds, seed);
}
