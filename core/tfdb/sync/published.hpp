// A few words that change together, in memory shared by processes.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "tfdb/sync/word.hpp"

namespace tfdb::sync {

/// A value of several words: a reader gets a value that was written, never a mixture of two.
///
/// A writer fills the unused slot, then increments the count. If it dies before that, the previous
/// value remains. The words start as zeros.
/// Threads: any read; one writes at a time, under a lock.
/// Guarantee: `write` is wait-free; `read` restarts only if a write ended meanwhile.
template <class Word, unsigned Words>
class BasicPublished {
public:
    using Value = std::array<std::uint64_t, Words>;
    static constexpr unsigned kWords = 1 + 2 * Words;

    explicit BasicPublished(Word* words) noexcept : words_(words) {}

    /// Empty before the first write.
    [[nodiscard]] std::optional<Value> read() const noexcept {
        for (;;) {
            const std::uint64_t written = words_[0].load_acquire();
            if (written == 0)
                return std::nullopt;
            Value value{};
            for (unsigned i = 0; i < Words; ++i)
                value[i] = slot(written)[i].load_relaxed();
            Word::fence_acquire();
            if (words_[0].load_relaxed() == written)
                return value;
        }
    }
    /// The number of writes.
    [[nodiscard]] std::uint64_t writes() const noexcept { return words_[0].load_acquire(); }
    void write(const Value& value) noexcept {
        const std::uint64_t written = words_[0].load_relaxed();
        // A reader that sees a word of this value also sees that its own slot is out of use.
        Word::fence_release();
        for (unsigned i = 0; i < Words; ++i)
            slot(written + 1)[i].store_relaxed(value[i]);
        words_[0].store_release(written + 1);
    }

private:
    [[nodiscard]] Word* slot(std::uint64_t number) const noexcept {
        return words_ + 1 + (number % 2) * Words;
    }

    Word* words_;
};

template <unsigned Words>
using Published = BasicPublished<Word, Words>;

}  // namespace tfdb::sync
