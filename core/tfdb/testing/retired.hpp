// The retired blocks of a checker's region, as Region keeps them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>

namespace tfdb::testing {

// Releases blocks in the order of their retirement. Needs the engine's lock.
class RetiredBlocks {
public:
    void add(std::uint64_t block, std::size_t bytes, std::uint64_t number) {
        blocks_.push_back({block, bytes, number});
        bytes_ += bytes;
    }
    // Stores in `word` the number up to which they are gone, before `release(block, bytes)`. False:
    // no more can be released.
    template <class Memory, class Word>
    bool reclaim(Memory& memory, Word& word, std::uint64_t oldest, std::size_t keep) {
        while (bytes_ > keep && blocks_.front().number <= oldest) {
            const Retired first = blocks_.front();
            blocks_.pop_front();
            bytes_ -= first.bytes;
            if (word.load_relaxed() < first.number) {
                word.store_relaxed(first.number);
                Memory::fence_release();
            }
            memory.release(first.block, first.bytes);
        }
        return false;
    }
    [[nodiscard]] std::size_t bytes() const { return bytes_; }
    template <class Visit>
    void visit(Visit visit) const {
        for (const Retired& retired : blocks_)
            visit(retired.block);
    }

private:
    struct Retired {
        std::uint64_t block;
        std::size_t bytes;
        std::uint64_t number;
    };
    std::deque<Retired> blocks_;
    std::size_t bytes_ = 0;
};

}  // namespace tfdb::testing
