// Which engine a store has.
#include "tfdb/store/engine.hpp"

#include "tfdb/engines/engines.hpp"
#include "tfdb/store/impl.hpp"

namespace tfdb::store {

std::unique_ptr<Engine> make_engine(Reads::Impl& impl) {
    switch (impl.concurrency) {
        case Concurrency::kSnapshot:
            return nullptr;
        case Concurrency::kGiant:
            return make_giant(impl);
        case Concurrency::kFine:
            return make_fine(impl);
        case Concurrency::kNoWait:
            return make_no_wait(impl);
        case Concurrency::kWaitDie:
            return make_wait_die(impl);
        case Concurrency::kWoundWait:
            return make_wound_wait(impl);
        case Concurrency::kSilo:
            return make_silo(impl);
    }
    return nullptr;
}

}  // namespace tfdb::store
