// Transactions: who may call what and when. What they do is the attempt's.
#include "tfdb/store/transaction.hpp"

#include <utility>

#include "tfdb/store/attempt.hpp"
#include "tfdb/store/attempt_errors.hpp"
#include "tfdb/store/open_transaction.hpp"
#include "tfdb/store/rows.hpp"
#include "tfdb/store/validate.hpp"

namespace tfdb {

using store::OpenTransaction;

/// Threads: the one that began it, but for the destructor. Guarantee: ends once.
struct Transaction::State {
    State(std::shared_ptr<Reads::Impl> of, const TransactionOptions& options)
        : impl(std::move(of)), thread(OpenTransaction::this_thread()) {
        if (options.priority > txn::Seniority::kMaxPriority) {
            throw InvalidArgument("a priority lies between 0 and 7, not " +
                                  std::to_string(options.priority));
        }
        if (options.age >> txn::Seniority::kAgeBits != 0) {
            throw InvalidArgument("an age is what `age()` of another attempt said, not " +
                                  std::to_string(options.age));
        }
        store::check_not_in_transaction(*impl);
        TransactionOptions aged = options;
        if (aged.age == 0)
            aged.age = impl->ages.fetch_add(1) + 1;
        age = aged.age;
        attempt = store::make_attempt(*impl, aged);
        entry = OpenTransaction::enter(*impl, options.alone, *attempt);
    }
    ~State() { end(nullptr); }
    State(const State&) = delete;
    State& operator=(const State&) = delete;

    /// Throws Forked, WrongThread, TransactionClosed.
    void check() const {
        if (forks != sync::forks())
            throw Forked("a transaction belongs to the process that began it");
        if (thread != OpenTransaction::this_thread())
            throw WrongThread("a transaction belongs to the thread that began it");
        if (ended != nullptr) {
            const std::string message = std::string("the transaction has ended: it was ") + ended;
            ErrorDetail detail;
            detail.reason = ended;
            throw TransactionClosed(message, std::move(detail));
        }
    }
    /// `how` null: aborted.
    void end(const char* how) noexcept {
        if (entry == nullptr)
            return;
        ended = how == nullptr ? "aborted" : how;
        if (forks != sync::forks()) {
            // Who had it in hand may not be here: what it holds in this copy stays as it is.
            (void)impl->whereabouts();
            (void)attempt.release();
            entry = nullptr;
            return;
        }
        std::exchange(entry, nullptr)->close(how == nullptr);
    }

    /// Calls the attempt. A Conflict ends it; so does what is no Error: memory may have run out
    /// amid a write, and half of one must never be committed.
    template <class Body>
    auto call(Body body) {
        check();
        try {
            return body(*attempt);
        } catch (const Conflict&) {
            lose();
            throw;
        } catch (const Error&) {
            throw;
        } catch (...) {
            end(nullptr);
            throw;
        }
    }
    void lose() noexcept {
        impl->conflicts.fetch_add(1);
        impl->aborts.fetch_add(1);
        end("lost to another one");
    }

    std::shared_ptr<Reads::Impl> impl;
    std::uint64_t thread;
    std::uint64_t forks = sync::forks();
    std::uint64_t age = 0;
    std::unique_ptr<store::Attempt> attempt;
    OpenTransaction* entry = nullptr;
    const char* ended = nullptr;
};

Transaction::Transaction(Buffer& buffer, const TransactionOptions& options)
    : state_(std::make_unique<State>(buffer.impl_, options)) {}

Transaction::~Transaction() = default;

bool Transaction::ask(Question& question, Answer& answer, Failure& failure) {
    return state_->call([&](auto& attempt) { return attempt.ask(question, answer, failure); });
}

bool Transaction::try_lookup(std::string_view target, std::string_view source,
                             std::optional<StampNs> stamp, Policy policy, Answer& answer,
                             Failure& failure) {
    Question question = store::at_stamp(target, source, stamp, policy);
    return ask(question, answer, failure);
}

bool Transaction::try_lookup_latest(std::string_view target, std::string_view source,
                                    std::optional<StampNs> max_age, StampNs now, Answer& answer,
                                    Failure& failure) {
    Question question = store::of_newest(target, source, max_age, now);
    return ask(question, answer, failure);
}

Answer Transaction::lookup_transform(std::string_view target, std::string_view source,
                                     std::optional<StampNs> stamp, Policy policy) {
    return store::answer_or_raise(*this, store::at_stamp(target, source, stamp, policy));
}

Answer Transaction::lookup_latest_transform(std::string_view target, std::string_view source,
                                            std::optional<StampNs> max_age, StampNs now) {
    return store::answer_or_raise(*this, store::of_newest(target, source, max_age, now));
}

Answer Transaction::lookup_transform_full(std::string_view target,
                                          std::optional<StampNs> target_stamp,
                                          std::string_view source,
                                          std::optional<StampNs> source_stamp,
                                          std::string_view fixed, Policy policy) {
    return store::answer_or_raise(
        *this, store::by_way_of(fixed, target, target_stamp, source, source_stamp, policy));
}

StampNs Transaction::latest_common_time(std::string_view target, std::string_view source) {
    return store::answer_or_raise(*this, store::by_name(Question::kCommonTime, target, source))
        .stamp;
}

CommonTimes Transaction::common_times(std::string_view target, std::string_view source) {
    const Answer answer =
        store::answer_or_raise(*this, store::by_name(Question::kCovered, target, source));
    return {answer.oldest, answer.stamp};
}

std::optional<std::string> Transaction::parent_of(std::string_view name,
                                                  std::optional<StampNs> stamp) {
    return state_->call([&](auto& attempt) { return attempt.parent_of(name, stamp); });
}

bool Transaction::has_frame(std::string_view name) {
    return state_->call([&](auto& attempt) { return attempt.has_frame(name); });
}

void Transaction::raise(const Failure& failure, const Question& question) const {
    store::raise_failure(failure, question, failure.commit, [this](FrameHandle frame) {
        return frame.id == kNoFrame ? std::string()
                                    : state_->attempt->frame_name(frame.id, frame.generation);
    });
}

std::string Transaction::frame_name(FrameId id, std::uint32_t generation) const {
    return state_->attempt->frame_name(id, generation);
}

void Transaction::set_transforms(std::span<const TransformView> batch, bool is_static,
                                 std::string_view authority) {
    state_->call([&](auto& attempt) { attempt.write(batch, is_static, authority); });
}

void Transaction::remove_frame(std::string_view name, bool recursive) {
    state_->call([&](auto& attempt) { attempt.remove_frame(name, recursive); });
}

void Transaction::reparent(std::string_view child, std::string_view parent,
                           std::optional<StampNs> stamp, const std::optional<Pose>& pose,
                           std::string_view authority) {
    const Pose placed = pose ? *pose : lookup_transform(parent, child, stamp).pose;
    const TransformView transform{parent, child, stamp.value_or(0), placed};
    set_transforms({&transform, 1}, !stamp, authority);
}

CommitNumber Transaction::commit() {
    try {
        const CommitNumber number = state_->call([](auto& attempt) { return attempt.commit(); });
        state_->end("committed");
        return number;
    } catch (const Error& error) {
        const bool called = error.code() != ErrorCode::kWrongThread;
        if (called)
            state_->end(nullptr);
        throw;
    } catch (...) {
        state_->end(nullptr);
        throw;
    }
}

void Transaction::end_thread() noexcept {
    OpenTransaction::end_thread();
}

void Transaction::abort() noexcept {
    state_->end(nullptr);
}

bool Transaction::is_open() const noexcept {
    return state_->entry != nullptr;
}

std::uint64_t Transaction::age() const noexcept {
    return state_->age;
}

void Transaction::lookup_many(std::string_view target, std::string_view source,
                              std::span<const StampNs> stamps, Policy policy, Layout layout,
                              Missing missing, std::span<double> out) {
    state_->check();
    store::check_room(stamps, layout, out);
    Answer answer;
    Failure failure;
    Question question = store::at_stamp(target, source, {}, policy);
    for (const int argument : {0, 1}) {
        if (!has_frame(argument == 0 ? target : source)) {
            failure.argument = argument;
            failure.commit = state_->attempt->read_as_of();
            raise(failure, question);
        }
    }
    for (std::size_t i = 0; i < stamps.size(); ++i) {
        if (i % 256 == 0)
            may_end();
        question.stamp = stamps[i];
        const bool found = ask(question, answer, failure);
        if (!found && missing == Missing::kThrow) {
            try {
                raise(failure, question);
            } catch (Error& error) {
                error.detail().index = i;
                throw;
            }
        }
        store::write_row(found ? &answer.pose : nullptr, layout,
                         out.data() + store::row_width(layout) * i);
    }
}

}  // namespace tfdb
