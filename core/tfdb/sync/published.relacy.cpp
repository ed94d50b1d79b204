// Published values in the C++ memory model.
#include "tfdb/sync/published.hpp"

// After all others: it redefines `assert` and more.
#include "tfdb/testing/relacy/simulate.hpp"

namespace tfdb::sync {

namespace {

/// One thread writes values of two equal words, the others read them.
template <unsigned Readers>
struct Values : rl::test_suite<Values<Readers>, Readers + 1> {
    using Pair = BasicPublished<relacy::Word, 2>;
    relacy::Word words[Pair::kWords];

    void thread(unsigned index) {
        if (index == 0) {
            for (std::uint64_t i = 1; i <= 3; ++i)
                Pair(words).write({i, i});
            return;
        }
        std::uint64_t before = 0;
        for (int i = 0; i < 2; ++i) {
            const auto value = Pair(words).read();
            const std::uint64_t found = value ? (*value)[0] : 0;
            RL_ASSERT(!value || (*value)[0] == (*value)[1]);
            RL_ASSERT(found >= before);
            before = found;
        }
    }
};

}  // namespace

TFDB_TEST(published_values_are_whole_in_the_memory_model) {
    relacy::holds<Values<1>>("one reader");
    relacy::holds<Values<2>>("two readers");
}

TFDB_TEST(published_values_need_their_fences) {
    relacy::needs<Values<1>>("the fence of the reader", {.no_acquire_fence = true});
    relacy::needs<Values<1>>("the fence of the writer", {.no_release_fence = true});
}

}  // namespace tfdb::sync
