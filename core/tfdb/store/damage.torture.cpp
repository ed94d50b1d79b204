// Files of shared stores with words that were changed at random: whoever opens one for reading and
// reads everything gets answers or typed errors, and ends.
//
//   torture_store_damage [--seconds 20] [--seed 1]
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <map>
#include <random>
#include <string>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/graph/frames.hpp"
#include "tfdb/memory/region.hpp"
#include "tfdb/store/buffer.hpp"
#include "tfdb/store/fixture.hpp"

namespace tfdb {
namespace {

constexpr std::size_t kBytes = std::size_t{16} << 20;
constexpr std::uint32_t kFrames = 200;
constexpr rlim_t kMostCpuSeconds = 10;
constexpr rlim_t kMostAddresses = rlim_t{8} << 30;

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

void read_all(const Reads& state) {
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

/// What a reader of the damaged file ended with: 0 all read, 1 refused.
int read_damaged(const std::string& path) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    const rlimit cpu{kMostCpuSeconds, kMostCpuSeconds};
    ::setrlimit(RLIMIT_CPU, &cpu);
    const rlimit addresses{kMostAddresses, kMostAddresses};
    ::setrlimit(RLIMIT_AS, &addresses);
    try {
        const Buffer buffer = Buffer::open(path, false);
        read_all(buffer);
        tried([&] { read_all(buffer.snapshot()); });
        tried([&] { (void)buffer.memory(); });
        tried([&] {
            (void)buffer.changes(buffer.commit() - std::min<CommitNumber>(buffer.commit(), 100));
        });
        return 0;
    } catch (const Error&) {
        return 1;
    } catch (const std::bad_alloc&) {
        return 0;  // said how much memory it would take: no harm
    }
}

/// A store's file, mapped, and which of its words lead anywhere.
class Victim {
public:
    Victim(const std::string& path, bool cleared) : path_(path) {
        BufferOptions options;
        options.max_frames = kFrames;
        options.history_ns = std::nullopt;
        ShareOptions share;
        share.size = kBytes;
        Buffer::create(path, share, options);
        Buffer buffer = Buffer::open(path, true);
        fill(buffer, cleared);
        const int file = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
        words_ = static_cast<std::uint64_t*>(
            ::mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0));
        ::close(file);
        const std::size_t root = memory::Region::root() / 8;
        const std::size_t table = words_[root + graph::kFrameTable] / 8;
        const std::size_t behind = table + graph::Frames<memory::Region>::bytes(kFrames) / 8;
        for (std::size_t i = 0; i < kBytes / 8; ++i) {
            if (words_[i] == 0)
                continue;
            filled_.push_back(i);
            if (i < root + graph::kStoreWords || (i >= table && i < behind))
                leading_.push_back(i);
        }
    }
    ~Victim() {
        ::munmap(words_, kBytes);
        Buffer::unlink(path_);
    }
    Victim(const Victim&) = delete;
    Victim& operator=(const Victim&) = delete;

    /// Changes up to three words, most of them among those that lead somewhere.
    void damage(std::mt19937_64& random) {
        for (std::uint64_t left = 1 + random() % 3; left > 0; --left) {
            const auto& from = random() % 5 != 0 ? leading_ : filled_;
            const std::size_t at = from[random() % from.size()];
            undo_.emplace_back(at, words_[at]);
            words_[at] = other(words_[at], random);
        }
    }
    void mend() {
        for (; !undo_.empty(); undo_.pop_back())
            words_[undo_.back().first] = undo_.back().second;
    }
    [[nodiscard]] std::string damages() const {
        std::string text;
        for (const auto& [at, was] : undo_) {
            std::array<char, 96> line{};
            std::snprintf(line.data(), line.size(), " word %zu: %llx -> %llx;", at,
                          static_cast<unsigned long long>(was),
                          static_cast<unsigned long long>(words_[at]));
            text += line.data();
        }
        return text;
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
                return words_[filled_[random() % filled_.size()]];
            default:
                return was ^ std::uint64_t{1} << random() % 64;
        }
    }

    std::string path_;
    std::uint64_t* words_ = nullptr;
    std::vector<std::size_t> filled_;
    std::vector<std::size_t> leading_;
    std::vector<std::pair<std::size_t, std::uint64_t>> undo_;
};

int torture(unsigned seconds, unsigned seed) {
    const std::string path = "/dev/shm/tfdb-damage-" + std::to_string(::getpid());
    std::mt19937_64 random(seed);
    std::array<unsigned, 3> counts{};  // read, refused, failed
    const std::time_t end = std::time(nullptr) + static_cast<std::time_t>(seconds);
    for (const bool cleared : {false, true}) {
        Victim victim(path, cleared);
        const std::time_t until = cleared ? end : end - static_cast<std::time_t>(seconds / 2);
        while (std::time(nullptr) < until) {
            victim.damage(random);
            const pid_t child = ::fork();
            if (child == 0)
                ::_exit(read_damaged(path));
            int status = 0;
            ::waitpid(child, &status, 0);
            const bool ended = WIFEXITED(status) && WEXITSTATUS(status) < 2;
            ++counts[ended ? static_cast<unsigned>(WEXITSTATUS(status)) : 2];
            if (!ended) {
                std::fprintf(stderr, "FAILED: a reader ended with status %x after%s\n",
                             static_cast<unsigned>(status), victim.damages().c_str());
            }
            victim.mend();
        }
    }
    std::printf("%u damaged stores read, %u refused, %u failures\n", counts[0], counts[1],
                counts[2]);
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
    for (int i = 1; i + 1 < argc; i += 2) {
        const std::string name = argv[i];
        const auto value = static_cast<unsigned>(std::strtoul(argv[i + 1], nullptr, 10));
        if (name == "--seconds")
            seconds = value;
        else if (name == "--seed")
            seed = value;
    }
    std::printf("seed %u\n", seed);
    return tfdb::torture(seconds, seed);
}
