#include "tfdb/memory/region.hpp"

#include <sys/mman.h>

#include <algorithm>
#include <map>
#include <memory>
#include <random>
#include <thread>
#include <vector>

#include "tfdb/base/error.hpp"
#include "tfdb/memory/block_sizes.hpp"
#include "tfdb/testing/check.hpp"

namespace tfdb::memory {
namespace {

constexpr std::size_t kMebi = std::size_t{1} << 20;

void check_class(std::size_t bytes, std::map<unsigned, std::size_t>& classes) {
    const BlockClass fit = block_class(bytes);
    CHECK(fit.bytes >= bytes);
    CHECK(fit.bytes % kLineBytes == 0);
    CHECK(fit.index < kSizeClasses);
    const std::size_t lines = round_up(bytes == 0 ? 1 : bytes, kLineBytes) / kLineBytes;
    const std::size_t wasted = fit.bytes / kLineBytes - lines;
    CHECK_EQ(class_bytes(fit.index), fit.bytes);
    const std::size_t whole = whole_block_lines(lines);
    CHECK(whole <= lines && 32 * (lines - whole) < lines);
    CHECK_EQ(block_class(whole * kLineBytes).bytes, whole * kLineBytes);
    CHECK(lines <= 16 ? wasted == 0 : 16 * wasted <= lines);
    const auto [known, added] = classes.try_emplace(fit.index, fit.bytes);
    CHECK_EQ(known->second, fit.bytes);
}

}  // namespace

TFDB_TEST(memory_block_classes_fit_every_size) {
    std::map<unsigned, std::size_t> classes;
    for (std::size_t bytes = 0; bytes <= 40'000; ++bytes)
        check_class(bytes, classes);
    for (unsigned shift = 16; shift < 40; ++shift) {
        for (std::size_t sixteenth = 0; sixteenth < 16; ++sixteenth) {
            const std::size_t at = (std::size_t{1} << shift) + (sixteenth << (shift - 4));
            for (const std::size_t bytes : {at - 1, at, at + 1, at + kLineBytes})
                check_class(bytes, classes);
        }
    }
    std::size_t before = 0;
    for (const auto& [index, bytes] : classes) {
        CHECK(bytes > before);  // a greater class is a greater block
        before = bytes;
    }
}

TFDB_TEST(memory_blocks_do_not_overlap_and_keep_their_words) {
    Region memory;
    std::mt19937 random(7);
    struct Block {
        std::size_t bytes;
        std::uint64_t value;
    };
    std::map<Offset, Block> blocks;
    std::uint64_t value = 1;
    for (int i = 0; i < 4000; ++i) {
        if (!blocks.empty() && random() % 3 == 0) {
            const auto at = std::next(blocks.begin(), static_cast<long>(random() % blocks.size()));
            for (std::size_t word = 0; word < at->second.bytes / 8; ++word)
                CHECK_EQ(memory.word(at->first + 8 * word).load_relaxed(), at->second.value);
            memory.release(at->first, at->second.bytes);
            blocks.erase(at);
            continue;
        }
        const std::size_t bytes = 8 * (1 + random() % (random() % 10 == 0 ? 2000 : 30));
        const Offset block = memory.allocate(bytes);
        CHECK(block % kLineBytes == 0);
        for (std::size_t word = 0; word < bytes / 8; ++word)
            memory.word(block + 8 * word).store_relaxed(value);
        const auto next = blocks.emplace(block, Block{bytes, value++}).first;
        if (next != blocks.begin())
            CHECK(std::prev(next)->first + std::prev(next)->second.bytes <= block);
        if (std::next(next) != blocks.end())
            CHECK(block + bytes <= std::next(next)->first);
    }
}

TFDB_TEST(memory_released_blocks_are_used_again) {
    Region memory;
    const std::size_t empty = memory.used_bytes();
    std::vector<Offset> blocks;
    for (int i = 0; i < 100; ++i)
        blocks.push_back(memory.allocate(1000));
    const std::size_t full = memory.used_bytes();
    CHECK_EQ(full - empty, 100 * block_class(1000).bytes);
    CHECK_EQ(memory.free_bytes(), 0U);
    for (const Offset block : blocks)
        memory.release(block, 1000);
    CHECK_EQ(memory.used_bytes(), empty);
    CHECK_EQ(memory.free_bytes(), full - empty);
    for (int i = 0; i < 100; ++i) {
        const Offset again = memory.allocate(970);  // the same class
        CHECK(std::find(blocks.begin(), blocks.end(), again) != blocks.end());
    }
    CHECK_EQ(memory.used_bytes(), full);
    CHECK_EQ(memory.free_bytes(), 0U);
}

TFDB_TEST(memory_of_a_large_block_serves_smaller_ones) {
    Region memory;
    const Offset large = memory.allocate(kMebi);
    (void)memory.allocate(64);
    const Offset end = memory.end();
    memory.release(large, kMebi);
    const std::size_t used = memory.used_bytes();
    const std::size_t free = memory.free_bytes();
    std::size_t taken = 0;
    for (std::size_t bytes = 64; taken + bytes <= kMebi * 3 / 4; bytes += 832) {
        const Offset block = memory.allocate(bytes);
        CHECK(large <= block && block + bytes <= large + kMebi);
        taken += block_class(bytes).bytes;
        CHECK_EQ(memory.used_bytes(), used + taken);
        CHECK_EQ(memory.free_bytes(), free - taken);
    }
    CHECK_EQ(memory.end(), end);
}

TFDB_TEST(memory_stays_as_large_as_it_is_however_often_it_is_swept) {
    Region memory;
    (void)memory.allocate(64);
    (void)memory.allocate_sparse(4 * kMebi);
    std::mt19937 random(3);
    std::vector<Region::Block> kept;
    Offset after_some = 0;
    for (std::uint64_t round = 1; round <= 400; ++round) {
        for (int i = 0; i < 60; ++i) {  // with sizes that differ from round to round
            const std::size_t bytes = 64 + random() % (random() % 8 == 0 ? 40'000 : 2000);
            const Offset block = memory.allocate(bytes);
            memory.word(block).store_relaxed(round);
            if (random() % 3 == 0)
                memory.release(block, bytes);
            else if (random() % 3 == 0)  // the other blocks are lost
                kept.push_back({block, bytes});
        }
        std::shuffle(kept.begin(), kept.end(), random);
        kept.resize(std::min<std::size_t>(kept.size(), 50));
        std::vector<Region::Block> in_use = kept;
        in_use.push_back({Region::root(), 64});
        memory.sweep(std::move(in_use), round, round);
        if (round == 40)
            after_some = memory.end();
    }
    CHECK(memory.end() <= after_some + after_some / 8);
}

TFDB_TEST(memory_that_was_filled_and_freed_can_be_filled_again_with_other_sizes) {
    Region memory;
    CHECK_EQ(memory.allocate(64), Region::root());
    (void)memory.allocate_sparse(memory.capacity() - 18 * kMebi);  // 16 and some are left
    for (std::uint64_t round = 1; round <= 30; ++round) {
        const std::size_t bytes = 1000 * round + 64;
        std::size_t taken = 0;
        try {
            for (;;) {
                (void)memory.allocate(bytes);
                taken += bytes;
            }
        } catch (const CapacityExceeded&) {
            CHECK(taken > 15 * kMebi);
        }
        CHECK(memory.is_short());
        memory.sweep({{Region::root(), 64}}, round, round);
        CHECK(!memory.is_short());
    }
}

TFDB_TEST(memory_that_was_given_back_is_memory_again_when_it_is_used) {
    Region memory;
    (void)memory.allocate(64);
    const auto resident = [&](Offset from, std::size_t bytes) {
        std::vector<unsigned char> pages(bytes / 4096);
        // The region begins at a page boundary.
        CHECK_EQ(::mincore(&memory.word(from / 4096 * 4096), bytes, pages.data()), 0);
        return std::count_if(pages.begin(), pages.end(), [](unsigned char c) { return c & 1; });
    };
    std::vector<Offset> blocks;
    for (int i = 0; i < 600; ++i) {
        blocks.push_back(memory.allocate(20'000));
        for (Offset at = 0; at < 20'000; at += 4000)
            memory.word(blocks.back() + at).store_relaxed(7);
    }
    const std::size_t bytes = 11 * kMebi;
    CHECK_EQ(resident(blocks.front(), bytes), static_cast<std::ptrdiff_t>(bytes / 4096));
    memory.sweep({{Region::root(), 64}, {blocks.back(), 20'000}}, 1, 1);
    memory.give_back();
    CHECK(resident(blocks.front(), bytes) < static_cast<std::ptrdiff_t>(bytes / 4096 / 2));
    CHECK_EQ(memory.word(blocks.back()).load_relaxed(), 7U);
    const Offset end = memory.end();
    for (int i = 0; i < 500; ++i)
        memory.word(memory.allocate(20'000)).store_relaxed(8);
    CHECK(memory.end() <= end + kMebi);
    CHECK_EQ(memory.word(blocks.back()).load_relaxed(), 7U);
}

TFDB_TEST(memory_limit_is_kept_and_leaves_everything_usable) {
    Region memory(64 * 1024);
    std::vector<Offset> blocks;
    CHECK_THROWS_AS(
        [&] {
            for (;;)
                blocks.push_back(memory.allocate(4096));
        }(),
        CapacityExceeded);
    CHECK_EQ(blocks.size(), 16U);
    CHECK_EQ(memory.used_bytes(), 16U * 4096);
    CHECK_THROWS_AS(memory.allocate(64), CapacityExceeded);
    CHECK_THROWS_AS(memory.allocate(std::size_t{1} << 62), CapacityExceeded);
    memory.release(blocks.back(), 4096);
    CHECK_EQ(memory.allocate(4096), blocks.back());
    CHECK_EQ(memory.used_bytes(), 16U * 4096);
}

TFDB_TEST(memory_released_blocks_stay_mapped) {
    Region memory;
    // Small blocks keep their words (except the free list's); large ones may read as zero.
    const Offset small = memory.allocate(512);
    const Offset large = memory.allocate(4 * kMebi);
    for (std::size_t word = 0; word < 64; ++word)
        memory.word(small + 8 * word).store_relaxed(word + 1);
    for (std::size_t at = 0; at < 4 * kMebi; at += 4096)
        memory.word(large + at).store_relaxed(7);
    memory.release(small, 512);
    memory.release(large, 4 * kMebi);
    for (std::size_t word = 1; word < 64; ++word)
        CHECK_EQ(memory.word(small + 8 * word).load_relaxed(), word + 1);
    for (std::size_t at = 4096; at < 4 * kMebi; at += 4096) {
        const std::uint64_t stale = memory.word(large + at).load_relaxed();
        CHECK(stale == 0 || stale == 7);
    }
    CHECK_EQ(memory.allocate(4 * kMebi), large);
    memory.word(large + 2 * kMebi).store_relaxed(9);
    CHECK_EQ(memory.word(large + 2 * kMebi).load_relaxed(), 9U);
}

TFDB_TEST(memory_sparse_blocks_are_zero_and_do_not_count) {
    Region memory;
    const std::size_t used = memory.used_bytes();
    const Offset table = memory.allocate_sparse(200 * kMebi);
    CHECK_EQ(memory.used_bytes(), used);
    for (std::size_t at = 0; at < 200 * kMebi; at += 16 * kMebi)
        CHECK_EQ(memory.word(table + at).load_relaxed(), 0U);
    const Offset after = memory.allocate(64);
    CHECK(after >= table + 200 * kMebi || after < table);
}

#if !defined(__SANITIZE_THREAD__)  // it leaves a program a hundredth of the addresses
TFDB_TEST(memory_of_thousands_of_stores_finds_room) {
    std::vector<std::unique_ptr<Region>> stores;
    for (int i = 0; i < 5000; ++i) {
        stores.push_back(std::make_unique<Region>());
        const Offset block = stores.back()->allocate(64);
        stores.back()->word(block).store_relaxed(static_cast<std::uint64_t>(i));
        // Large enough for the largest table of frames and a few hundred thousand samples.
        CHECK(stores.back()->allocate_sparse(512 * kMebi) != 0);
    }
    CHECK_EQ(stores.front()->word(Region::root()).load_relaxed(), 0U);
    CHECK_EQ(stores.back()->word(Region::root()).load_relaxed(), 4999U);
    // Destroyed stores return their addresses: the next one is as large as the first one was.
    stores.clear();
    Region next;
    CHECK(next.allocate_sparse(200'000 * kMebi) != 0);
}
#endif

TFDB_TEST(memory_is_shared_by_threads_that_allocate_and_release) {
    constexpr std::uint64_t kThreads = 4;
    Region memory;
    std::vector<std::thread> running;
    std::vector<std::size_t> kept(kThreads);
    for (std::uint64_t thread = 0; thread < kThreads; ++thread) {
        running.emplace_back([&memory, &kept, thread] {
            struct Block {
                Offset at;
                std::size_t bytes;
            };
            std::mt19937_64 random(11 + thread);
            std::vector<Block> mine;
            const auto check_and_drop = [&] {
                const Block block = mine[random() % mine.size()];
                for (std::size_t at = 0; at < block.bytes; at += 8)
                    CHECK_EQ(memory.word(block.at + at).load_relaxed(), thread << 32 | block.bytes);
                memory.release(block.at, block.bytes);
                std::erase_if(mine, [&](const Block& held) { return held.at == block.at; });
            };
            for (int i = 0; i < 4000; ++i) {
                const Block block{0, 64 * (1 + random() % 12)};
                mine.push_back({memory.allocate(block.bytes), block.bytes});
                for (std::size_t at = 0; at < block.bytes; at += 8)
                    memory.word(mine.back().at + at).store_relaxed(thread << 32 | block.bytes);
                while (mine.size() > 20)
                    check_and_drop();
            }
            for (const Block& block : mine)
                kept[thread] += block_class(block.bytes).bytes;
        });
    }
    for (std::thread& thread : running)
        thread.join();
    std::size_t all = 0;
    for (const std::size_t bytes : kept)
        all += bytes;
    CHECK_EQ(memory.used_bytes(), all);
}

}  // namespace tfdb::memory
