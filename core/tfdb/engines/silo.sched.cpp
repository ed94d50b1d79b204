// Every interleaving of the optimistic engine, and with a broken promise.
#include "tfdb/engines/silo.hpp"

#include "tfdb/engines/engines.sched.hpp"

namespace tfdb::txn::engines {

namespace {

using S = SiloSession<ForestMemory>;

// One thread keeps the first value that it loads of a word. Create one per execution.
class Believes : public sched::Interceptor {
public:
    Believes(std::size_t thread, sched::Which which) : thread_(thread), which_(std::move(which)) {}

    sched::Effect access(sched::Word& word, const sched::Operation& operation) override {
        const sched::Effect effect = word.access_directly(operation);
        if (!which_(word) || sched::Run::inside_thread()->current() != thread_)
            return effect;
        first_ = first_.value_or(effect.before);
        return {*first_, *first_, false};
    }

private:
    std::size_t thread_;
    sched::Which which_;
    std::optional<std::uint64_t> first_;
};

// A returned version stays the same after the next write. Create one per execution.
class KeepsVersion : public sched::Interceptor {
public:
    explicit KeepsVersion(sched::Which which) : which_(std::move(which)) {}

    sched::Effect access(sched::Word& word, const sched::Operation& operation) override {
        sched::Operation changed = operation;
        if (which_(word) && operation.kind == sched::Kind::kExchange)
            changed.operand = 0;
        return word.access_directly(changed);
    }

private:
    sched::Which which_;
};

}  // namespace

TFDB_SCHED(silo_stands) {
    must_stand<S>({kOdom, kBase});
}

TFDB_SCHED(silo_flaws_are_found) {
    sched::Walk walk;
    walk.must_fail("a reader that believes its first look", "both edges of one batch",
                   acted<S>({reader<S>(), writer<S>(20)}, newest_is<S>(20, 20, 6),
                            in_region<S>([](Stage<S>& stage) {
                                return std::make_unique<Believes>(0, lock_of(stage, kBase));
                            })));
    walk.must_fail("a version that is not raised", "both edges of one batch",
                   acted<S>({reader<S>(), writer<S>(20)}, newest_is<S>(20, 20, 6),
                            in_region<S>([](Stage<S>& stage) {
                                return std::make_unique<KeepsVersion>(lock_of(stage, kBase));
                            })));
    walk.must_fail(
        "frames locked in any order", "deadlock",
        acted<S>({writer<S>(20), writer<S>(21, {kBase, kOdom})}, newest_is<S>(21, 21, 8)));
    walk.must_fail("a writer without locks", "no sample was lost",
                   acted<S>({writer<S>(20), writer<S>(21)}, newest_is<S>(21, 21, 8),
                            in_region<S>([](Stage<S>& stage) {
                                return std::make_unique<Pretends>(0, locks_of(stage));
                            })));
}

}  // namespace tfdb::txn::engines
