// Names and the frame table in a region of their own.
#include "tfdb/graph/names.hpp"

#include <map>
#include <random>
#include <set>

#include "tfdb/base/error.hpp"
#include "tfdb/memory/region.hpp"
#include "tfdb/testing/check.hpp"
#include "tfdb/testing/sanitized.hpp"

namespace tfdb::graph {
namespace {

using Memory = memory::Region;

/// A frame table with its names, driven as a commit does.
/// Threads: one. Guarantee: none but what the tables give.
class Table {
public:
    explicit Table(std::uint32_t max_frames, std::size_t limit = Memory::kNoLimit)
        : memory(limit),
          frames(memory, memory.allocate(kStoreBytes),
                 memory.allocate_sparse(Frames<Memory>::bytes(max_frames)), max_frames),
          names(frames) {}

    FrameId make(std::string_view name, CommitNumber commit) {
        names.reserve();
        const Offset block = names.store_name(name);
        FrameId id = frames.first_retired();
        if (id != kNoFrame) {
            frames.pop_retired();
            frames.seal(id);
        } else {
            id = frames.take_fresh_slot();
        }
        frames.make(id, commit, block);
        names.insert(name, id);
        return id;
    }
    /// Removes the frame from `commit` on; its slot may be reused.
    void retire(FrameId id, CommitNumber commit) {
        frames.word(id, history::kDied).store_relaxed(commit);
        auto& topology = frames.word(id, history::kTopology);
        topology.store_release(topology.load_relaxed() | history::Topology::kMortal);
        const Offset block = frames.word(id, history::kName).load_relaxed();
        names.erase(id);
        frames.word(id, history::kName).store_release(0);
        names.free_name(block);
        frames.push_retired(id);
    }

    Memory memory;
    Frames<Memory> frames;
    Names<Memory> names;
};

/// The number of entries that `find` reads until it reaches the frame.
std::uint64_t probes_for(const Table& table, FrameId id) {
    const std::uint64_t where = table.frames.store_word(kNames).load_acquire();
    const std::uint64_t mask = TableWord::capacity(where) - 1;
    std::uint64_t at = hash_name(table.names.name(id)) & mask;
    std::uint64_t probes = 1;
    const auto entry = [&] {
        return table.memory.word(TableWord::block(where) + 8 * at).load_acquire();
    };
    for (; static_cast<std::uint32_t>(entry()) != id + 1; ++probes)
        at = (at + 1) & mask;
    return probes;
}

std::string long_name(std::size_t length, char last) {
    std::string name(length, 'x');
    name.back() = last;
    return name;
}

}  // namespace

TFDB_TEST(names_are_found_while_the_table_grows) {
    Table table(100'000);
    CHECK_EQ(table.names.find("ghost", 9), kNoFrame);
    for (std::uint32_t i = 0; i < 20'000; ++i)
        CHECK_EQ(table.make("frame_" + std::to_string(i), i + 1), i);
    CHECK_EQ(table.frames.count(), 20'000U);
    for (std::uint32_t i = 0; i < 20'000; ++i) {
        const std::string name = "frame_" + std::to_string(i);
        CHECK_EQ(table.names.find(name, 20'000), i);
        CHECK_EQ(table.names.find(name, i + 1), i);
        CHECK_EQ(table.names.find(name, i), kNoFrame);  // before its birth
        CHECK_EQ(table.names.name(i), name);
    }
    CHECK_EQ(table.names.find("frame_", 20'000), kNoFrame);
    CHECK_EQ(table.names.find("frame_20000", 20'000), kNoFrame);
}

TFDB_TEST(names_that_share_a_bucket_are_told_apart) {
    // In a table of 64 entries, names whose hashes agree in the low six bits.
    Table table(64);
    std::vector<std::string> names;
    for (int i = 0; names.size() < 12; ++i) {
        std::string name = "n" + std::to_string(i);
        if ((hash_name(name) & 63) == 61)  // their entries also wrap around the end
            names.push_back(std::move(name));
    }
    for (std::size_t i = 0; i < names.size(); ++i)
        CHECK_EQ(table.make(names[i], 1), i);
    for (std::size_t i = 0; i < names.size(); ++i)
        CHECK_EQ(table.names.find(names[i], 1), i);
    table.retire(3, 2);  // the ones behind it must still be found
    for (std::size_t i = 0; i < names.size(); ++i)
        CHECK_EQ(table.names.find(names[i], 2), i == 3 ? kNoFrame : i);
}

TFDB_TEST(names_that_differ_in_a_number_only_are_found_at_once) {
    constexpr std::string_view kPrefixes[] = {
        "f",        "joint",     "link_", "robot_7/arm/link_", "/camera/frame/of/row/", "obj",
        "tag36h11", "left_leg_", "wheel", "world/model/part-"};
    for (const FrameId count : {10U, 100U, 500U, 1000U, 10'000U, testing::rounds(100'000U)}) {
        std::uint64_t in_all = 0;
        for (const std::string_view prefix : kPrefixes) {
            Table table(count);
            for (FrameId i = 0; i < count; ++i)
                (void)table.make(std::string(prefix) + std::to_string(i), 1);
            std::uint64_t probes = 0;
            for (FrameId i = 0; i < count; ++i)
                probes += probes_for(table, i);
            CHECK(probes <= 2 * count);
            in_all += probes;
        }
        // As good as random hashing in a table that is at most half full.
        CHECK(2 * in_all <= 3 * std::size(kPrefixes) * count);
    }
}

TFDB_TEST(names_of_every_length_up_to_the_longest) {
    Table table(3000);
    for (std::size_t length = 1; length <= kMaxNameBytes; ++length) {
        const FrameId a = table.make(long_name(length, 'a'), 1);
        const FrameId b = table.make(long_name(length, 'b'), 1);
        CHECK_EQ(table.names.name(a), long_name(length, 'a'));
        CHECK_EQ(table.names.find(long_name(length, 'b'), 1), b);
    }
    for (std::size_t length = 1; length <= kMaxNameBytes; ++length)
        CHECK_EQ(table.names.find(long_name(length, 'a'), 1), 2 * (length - 1));
    CHECK_EQ(table.names.find(long_name(kMaxNameBytes + 1, 'a'), 1), kNoFrame);
}

TFDB_TEST(names_bytes_that_differ_anywhere_are_different_names) {
    Table table(600);
    std::map<std::string, FrameId> made;
    const std::string base = "0123456789abcdefg\xC3\xA4";
    for (std::size_t at = 0; at < base.size(); ++at) {
        std::string name = base;
        name[at] = '~';
        made.emplace(name, table.make(name, 1));
        made.emplace(base.substr(0, at + 1), table.make(base.substr(0, at + 1), 1));
    }
    for (const auto& [name, id] : made)
        CHECK_EQ(table.names.find(name, 1), id);
}

TFDB_TEST(names_made_again_are_new_frames_in_reused_slots) {
    Table table(8);
    std::set<std::uint32_t> generations;
    CommitNumber commit = 1;
    FrameId id = table.make("tool", commit);
    const FrameId other = table.make("base", commit);
    for (int i = 0; i < 1000; ++i) {
        generations.insert(table.frames.generation(id));
        table.retire(id, ++commit);
        CHECK_EQ(table.names.find("tool", commit), kNoFrame);
        id = table.make("tool", ++commit);
        CHECK_EQ(table.names.find("tool", commit), id);
        CHECK_EQ(table.names.find("tool", commit - 1), kNoFrame);
        CHECK_EQ(table.names.find("base", commit), other);
    }
    CHECK_EQ(generations.size(), 1000U);
    CHECK_EQ(table.frames.count(), 2U);
}

TFDB_TEST(names_memory_stays_flat_when_names_come_and_go) {
    Table table(600);
    std::vector<FrameId> living;
    std::size_t most = 0;
    for (CommitNumber commit = 1; commit <= 20'000; ++commit) {
        if (living.size() == 500) {
            table.retire(living.front(), commit);
            living.erase(living.begin());
        }
        living.push_back(table.make("visit_" + std::to_string(commit), commit));
        if (commit == 5000)
            most = table.memory.used_bytes() + 3 * 8 * 2048;  // a table of another size
        CHECK(most == 0 || table.memory.used_bytes() <= most);
    }
    CHECK_EQ(table.frames.count(), 500U);
}

TFDB_TEST(names_limit_is_refused_and_nothing_lost) {
    Table table(1000, 16 * 1024);
    std::uint32_t made = 0;
    CHECK_THROWS_AS(
        [&] {
            for (;; ++made)
                (void)table.make("frame_" + std::to_string(made), 1);
        }(),
        CapacityExceeded);
    CHECK(made > 50);
    for (std::uint32_t i = 0; i < made; ++i)
        CHECK_EQ(table.names.find("frame_" + std::to_string(i), 1), i);
}

TFDB_TEST(frames_live_from_birth_to_death) {
    Table table(4);
    const FrameId id = table.make("a", 5);
    CHECK(!table.frames.alive(id, 4));
    CHECK(table.frames.alive(id, 5));
    CHECK(table.frames.alive(id, 900));
    table.retire(id, 7);
    CHECK(!table.frames.alive(id, 4));
    CHECK(table.frames.alive(id, 6));
    CHECK(!table.frames.alive(id, 7));
    const std::uint32_t before = table.frames.generation(id);
    CHECK_EQ(table.make("b", 9), id);
    CHECK(table.frames.generation(id) != before);
    CHECK(!table.frames.alive(id, 8));
    CHECK_EQ(table.frames.born(id), 9U);
    CHECK_EQ(table.frames.topology(id), history::Topology::kRoot);
}

TFDB_TEST(frames_slots_are_reused_oldest_first_and_run_out) {
    Table table(3);
    CHECK_EQ(table.make("a", 1), 0U);
    CHECK_EQ(table.make("b", 1), 1U);
    CHECK_EQ(table.make("c", 1), 2U);
    CHECK_EQ(table.frames.take_fresh_slot(), kNoFrame);
    CHECK_EQ(table.frames.first_retired(), kNoFrame);
    table.retire(1, 2);
    table.retire(0, 3);
    CHECK_EQ(table.make("d", 4), 1U);
    CHECK_EQ(table.make("e", 4), 0U);
    CHECK_EQ(table.frames.first_retired(), kNoFrame);
}

}  // namespace tfdb::graph
