// Control file of a shared store: the writers' mutex and one slot of reader pins per process.
#pragma once

#include <pthread.h>

#include <cstdint>
#include <string>

#include "tfdb/base/types.hpp"
#include "tfdb/memory/mapping.hpp"
#include "tfdb/sync/word.hpp"

namespace tfdb::memory {

/// A small file beside the data. It holds the lock of the writers of all processes, and one slot
/// per process for the pins of its reads. Read-only processes may still write here.
///
/// The lock is a robust mutex: the kernel releases it when its holder dies, and reports that. A
/// process owns a slot as long as it has the slot's byte of the file locked; the kernel releases
/// that lock as well. So both work across pid namespaces, and a reused pid is never mistaken for
/// the owner.
/// Threads: any; a process holds the lock once, so its threads must exclude each other before.
/// Guarantee: `pins` is wait-free; the lock blocks.
class Control {
public:
    static constexpr unsigned kSlots = 2048;
    static constexpr unsigned kSlotWords = 16;
    static constexpr unsigned kProcessWord = 15;  // of a slot: its process; pins do not use it
    static constexpr std::size_t kBytes = 4096 + std::size_t{kSlots} * kSlotWords * 8;

    /// Initialises a new file of that many bytes. Throws CapacityExceeded.
    static void prepare(const Mapping& mapping, std::uint64_t id);
    /// Takes a slot of the store at a path, and owns the file. Throws CapacityExceeded if no slot
    /// is free. Throws CorruptStore for another kind of file, a truncated one, or another store's.
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
        kBroken,      // the lock is unusable: its words were damaged
    };
    [[nodiscard]] Taken try_lock() noexcept;
    /// Waits at most this long, measured by `sync::steady_now`.
    [[nodiscard]] Taken lock(std::int64_t longest_ns) noexcept;
    /// Marks the mutex consistent after the dead holder's work was repaired.
    void consistent() noexcept;
    void unlock() noexcept;
    /// The process that holds the lock; 0 if it is free.
    [[nodiscard]] std::int64_t holder() const noexcept;
    /// Whether another process holds it.
    [[nodiscard]] bool is_held_elsewhere() const noexcept;

    /// Counts of writers' deaths: all repaired, and those repaired before the last sweep.
    [[nodiscard]] sync::Word& deaths() const noexcept { return word(3); }
    [[nodiscard]] sync::Word& swept_deaths() const noexcept { return word(4); }

    /// The word on which waits for a commit sleep: see sync::EventCount.
    [[nodiscard]] sync::Word& commit_event() const noexcept { return word(kCommitEventWord); }
    /// Whether a process with write permission here has removed the store.
    [[nodiscard]] bool removed() const noexcept { return word(kRemovedWord).load_acquire() != 0; }

    static constexpr unsigned kClockWords = 9;
    /// The setting of the store's clock, and the word on which its sleepers sleep.
    [[nodiscard]] sync::Word* clock() const noexcept { return &word(kClockWord); }
    [[nodiscard]] sync::Word& clock_event() const noexcept { return word(kClockEventWord); }

    /// The words of this process's slot.
    [[nodiscard]] sync::Word* pins() const noexcept { return slot(mine_); }
    /// Upper bound of the slots that were ever taken.
    [[nodiscard]] unsigned slots() const noexcept;
    [[nodiscard]] sync::Word* slot(unsigned index) const noexcept;
    /// Number of slots in use: a process has one for each time that it opened the store.
    [[nodiscard]] unsigned count_processes() const;
    /// In a forked child, which still shares its parent's slot: takes a slot of its own. False: all
    /// slots are in use.
    bool take_own_slot() noexcept;
    /// Frees the slot of a process that has ended; false: the process is alive.
    bool free_if_dead(unsigned index) const noexcept;

    /// Whether a mapped file is the control file of that store.
    [[nodiscard]] static bool is_of(const Mapping& mapping, std::uint64_t id) noexcept;
    /// Wakes the waits and sleeps on this file after its store was removed.
    static void notify_removal(const Mapping& mapping) noexcept;

private:
    static constexpr unsigned kCommitEventWord = 6;
    static constexpr unsigned kRemovedWord = 7;
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
    bool is_reopened_ = false;  // whether this is another open file, after a fork
    unsigned mine_ = 0;
    std::uint64_t pid_ = 0;        // this process's pid after `pid_forks_` forks;
    std::uint64_t pid_forks_ = 0;  // only the thread that locks uses both
};

}  // namespace tfdb::memory
