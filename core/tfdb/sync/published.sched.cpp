// Every interleaving of readers and writers of a published value.
#include "tfdb/sync/published.hpp"

#include <array>
#include <cstdint>
#include <functional>
#include <memory>

#include "tfdb/testing/sched/flaws.hpp"
#include "tfdb/testing/sched/walk.hpp"

namespace tfdb::sync {

namespace {

using sched::Program;
using sched::Run;
using sched::Walk;

using Pair = BasicPublished<sched::Word, 2>;
using Flaw = std::function<std::unique_ptr<sched::Interceptor>(sched::Word* words)>;
constexpr std::size_t kReader = 0;
constexpr std::size_t kWriter = 1;

/// Two words that are always equal, in a value written `writes` times.
Program reading(std::uint64_t writes, int more_readers = 0, std::size_t dies_after = Run::kNever,
                const Flaw& flaw = {}) {
    return [=](Run& run) {
        std::array<sched::Word, Pair::kWords> words;
        for (sched::Word& word : words) {
            word.rename("word", static_cast<std::uint32_t>(&word - words.data()));
            run.touch(word);
        }
        const auto interceptor = flaw ? flaw(words.data()) : nullptr;
        for (sched::Word& word : words)
            word.intercept(interceptor.get());
        const auto read = [&words] {
            std::uint64_t before = 0;
            for (int i = 0; i < 2; ++i) {
                const auto value = Pair(words.data()).read();
                const std::uint64_t found = value ? (*value)[0] : 0;
                SCHED_REQUIRE(!value || (*value)[0] == (*value)[1]);
                SCHED_REQUIRE(found >= before);
                before = found;
            }
        };
        run.thread("reads", read);
        run.thread(
            "writes",
            [&words, writes] {
                for (std::uint64_t i = 1; i <= writes; ++i)
                    Pair(words.data()).write({i, i});
            },
            dies_after);
        for (int i = 0; i < more_readers; ++i)
            run.thread("reads, too", read);
        run.join();
    };
}

}  // namespace

TFDB_SCHED(published_values_are_whole) {
    Walk walk;
    walk.must_hold("one reader, three writes", reading(3));
    sched::Options options;
    options.preemptions = 2;
    Walk bounded(options);
    bounded.must_hold("two readers, three writes", reading(3, 1));
}

TFDB_SCHED(published_values_survive_the_death_of_a_writer) {
    Walk walk;
    for (std::size_t accesses = 0; accesses < 9; ++accesses)
        walk.must_hold("a death after " + std::to_string(accesses), reading(3, 0, accesses));
}

TFDB_SCHED(published_flaws_are_found) {
    Walk walk;
    walk.must_fail("a reader that does not look again", "(*value)[0] == (*value)[1]",
                   reading(3, 0, Run::kNever, [](sched::Word* words) {
                       return std::make_unique<sched::LooksOnce>(kReader, words[0]);
                   }));
    walk.must_fail("a writer that counts before it fills", "(*value)[0] == (*value)[1]",
                   reading(3, 0, Run::kNever, [](sched::Word* words) {
                       return std::make_unique<sched::Delays>(
                           kWriter, [words](const sched::Word& word) { return &word != words; },
                           words[0]);
                   }));
}

}  // namespace tfdb::sync
