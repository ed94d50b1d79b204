// Control file of a shared store: the writers' mutex and one slot of reader pins per process.
#pragma once

#include <pthread.h>

#include <cstdint>
#include <string>

#include "tfdb/base/types.hpp"
#include "tfdb/memory/mapping.hpp"
#include "tfdb/sync/word.hpp"

namespace tfdb::memory {

/// A small file beside the data: the lock that writers of all processes take, and slots for the
/// processes with the pins of what it reads. Read-only processes may still write here.
///
/// The lock is a robust mutex: the kernel hands it on when its holder dies, and reports that. A
/// slot is its process's as long as that has its byte of the file locked, which the kernel ends as
/// well; so both work across pid namespaces, and no pid is ever taken for another process's.
/// Threads: any; the lock is a process's own, so its threads take turns before they come here.
/// Guarantee: `pins` is wait-free; the lock blocks.
class Control {
public:
    static constexpr unsigned kSlots = 2048;
    static constexpr unsigned kSlotWords = 16;
    static constexpr unsigned kProcessWord = 15;  // of a slot: its process; pins leave it alone
    static constexpr std::size_t kBytes = 4096 + std::size_t{kSlots} * kSlotWords * 8;

    /// Readies a new file of that many bytes. Throws CapacityExceeded.
    static void prepare(const Mapping& mapping, std::uint64_t id);
    /// Takes a slot of the store at a path. The file is closed in the end. Throws CapacityExceeded
    /// where none is free, CorruptStore for another kind of file, a cut one, or another store's.
    Control(int file, std::uint64_t id, const std::string& path);
    ~Control();
    Control(const Control&) = delete;
    Control& operator=(const Control&) = delete;
    Control(Control&&) = delete;
    Control& operator=(Control&&) = delete;

    enum class Taken : std::uint8_t {
        kNo,
        kYes,
        kAfterDeath,  // the last holder died: repair, then `consistent`
        kBroken,      // the lock is none any more: its words were damaged
    };
    [[nodiscard]] Taken try_lock() noexcept;
    /// Waits at most so long, by `sync::steady_now`.
    [[nodiscard]] Taken lock(std::int64_t longest_ns) noexcept;
    /// What the dead holder was at has been repaired.
    void consistent() noexcept;
    void unlock() noexcept;
    /// The process that holds the lock, 0 if none does.
    [[nodiscard]] std::int64_t holder() const noexcept;
    /// Whether another process than this one holds it.
    [[nodiscard]] bool is_held_elsewhere() const noexcept;

    /// Counts of writers' deaths: repaired, and repaired before the last sweep.
    [[nodiscard]] sync::Word& deaths() const noexcept { return word(3); }
    [[nodiscard]] sync::Word& swept_deaths() const noexcept { return word(4); }

    /// The word on which waits for a commit sleep: see sync::EventCount.
    [[nodiscard]] sync::Word& commit_event() const noexcept { return word(kCommitEventWord); }
    /// How often the store was removed by a process with write permission here.
    [[nodiscard]] sync::Word& removals() const noexcept { return word(kRemovalsWord); }

    static constexpr unsigned kClockWords = 9;
    /// The setting of the store's clock, and the word on which sleeps by it sleep.
    [[nodiscard]] sync::Word* clock() const noexcept { return &word(kClockWord); }
    [[nodiscard]] sync::Word& clock_event() const noexcept { return word(kClockEventWord); }

    /// The words of this process's slot.
    [[nodiscard]] sync::Word* pins() const noexcept { return slot(mine_); }
    /// Slots that were ever taken are the first so many.
    [[nodiscard]] unsigned slots() const noexcept;
    [[nodiscard]] sync::Word* slot(unsigned index) const noexcept;
    /// How many processes have slots: a process has one for each time that it opened the store.
    [[nodiscard]] unsigned count_processes() const;
    /// In the child of a fork, which has its parent's slot so far: takes one of its own. False:
    /// there is none.
    bool take_own_slot() noexcept;
    /// Frees the slot of a process that is no more; false: it is alive.
    bool free_if_dead(unsigned index) const noexcept;

    /// Whether a mapped file is the control file of that store.
    [[nodiscard]] static bool is_of(const Mapping& mapping, std::uint64_t id) noexcept;
    /// Wakes the waits and the sleeps on such a file: the store was removed.
    static void tell_removal(const Mapping& mapping) noexcept;

private:
    static constexpr unsigned kCommitEventWord = 6;
    static constexpr unsigned kRemovalsWord = 7;
    static constexpr unsigned kClockEventWord = 8;
    static constexpr unsigned kClockWord = 9;

    [[nodiscard]] static sync::Word& word_of(const Mapping& mapping, unsigned index) noexcept {
        return reinterpret_cast<sync::Word*>(mapping.base())[index];
    }
    [[nodiscard]] sync::Word& word(unsigned index) const noexcept {
        return word_of(mapping_, index);
    }
    [[nodiscard]] pthread_mutex_t* mutex() const noexcept;
    [[nodiscard]] bool is_mutex() const noexcept;
    Taken took(int result) noexcept;
    [[nodiscard]] unsigned take_slot(const std::string& path);
    void clear(unsigned index) const noexcept;

    Mapping mapping_;
    int file_;                  // the mapping's: it owns the locks
    bool is_reopened_ = false;  // or another one, after a fork
    unsigned mine_ = 0;
    std::uint64_t pid_ = 0;        // of this process, after so many forks: only whose turn it is
    std::uint64_t pid_forks_ = 0;  // to lock looks at them
};

}  // namespace tfdb::memory
