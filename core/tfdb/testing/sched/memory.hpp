#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "tfdb/memory/memory.hpp"
#include "tfdb/testing/retired.hpp"
#include "tfdb/testing/sched/run.hpp"

namespace tfdb::sched {

// A small region of walked words: the engine's templates use it in a walk. Every walked thread may
// read and write words; allocate() and release() need the engine's lock. A released block is reused
// at once, the worst case for a reader that still accesses it. Fences do nothing: the walk is
// sequentially consistent, and Relacy checks the memory orders.
template <unsigned PayloadWords>
class BasicMemory {
public:
    using Word = sched::Word;
    using Offset = std::uint64_t;
    static constexpr unsigned kPayloadWords = PayloadWords;
    static constexpr std::size_t kLine = 64;

    explicit BasicMemory(std::size_t bytes) : words_(new Word[bytes / 8]), bytes_(bytes) {
        for (std::size_t index = 0; index < bytes / 8; ++index) {
            words_[index].rename(nullptr, static_cast<std::uint32_t>(index * 8));
        }
    }

    Word& word(Offset offset) const {
        return offset < bytes_ && offset % 8 == 0 ? words_[offset / 8] : outside();
    }

    /// Inserts an interceptor between the threads and all words of the region.
    void intercept(Interceptor* interceptor) {
        for (std::size_t index = 0; index < bytes_ / 8; ++index) {
            words_[index].intercept(interceptor);
        }
    }

    /// Blocks of whole lines; offset 0 is never returned.
    Offset allocate(std::size_t bytes) {
        const std::size_t lines = (bytes + kLine - 1) / kLine;
        std::vector<Offset>& waiting = free_[lines];
        if (!waiting.empty()) {
            const Offset block = waiting.back();
            waiting.pop_back();
            return block;
        }
        const Offset block = next_;
        next_ += lines * kLine;
        Run::require(next_ <= bytes_, "the walked region is large enough", __FILE__, __LINE__);
        return block;
    }
    void release(Offset block, std::size_t bytes) {
        free_[(bytes + kLine - 1) / kLine].push_back(block);
    }

    void retire(memory::Line line, Offset block, std::size_t bytes, std::uint64_t commit) {
        retired_[place(line)].add(block, bytes, commit);
    }
    bool reclaim(memory::Line line, std::uint64_t oldest, std::size_t keep) {
        return retired_[place(line)].reclaim(*this, reclaimed(line), oldest, keep);
    }
    [[nodiscard]] std::size_t retired_bytes(memory::Line line) const {
        return retired_[place(line)].bytes();
    }
    [[nodiscard]] Word& reclaimed(memory::Line line) const { return word(8 + 8 * place(line)); }

    /// The free and the retired blocks: no new read may lead to them.
    [[nodiscard]] std::vector<Offset> out_of_use() const {
        std::vector<Offset> blocks;
        for (const auto& [lines, free] : free_)
            blocks.insert(blocks.end(), free.begin(), free.end());
        for (const auto& line : retired_)
            line.visit([&](Offset block) { blocks.push_back(block); });
        return blocks;
    }

    static void fence_acquire() {}
    static void fence_release() {}
    static void fence_full() {}

private:
    static std::size_t place(memory::Line line) { return static_cast<std::size_t>(line); }
    [[noreturn]] static Word& outside() { throw Violation{"an access outside the region", {}}; }

    std::unique_ptr<Word[]> words_;
    std::size_t bytes_;
    Offset next_ = kLine;
    std::map<std::size_t, std::vector<Offset>> free_;
    std::array<testing::RetiredBlocks, memory::kLines> retired_;
};

using Memory = BasicMemory<2>;

}  // namespace tfdb::sched
