// Lookups of a Buffer or a Snapshot, each from one state.
#include <initializer_list>

#include "tfdb/store/impl.hpp"

namespace tfdb {

using lookup::Outcome;

namespace store {

void throw_snapshot_too_old(CommitNumber held, CommitNumber newest) {
    ErrorDetail detail;
    detail.commit = held;
    throw SnapshotTooOld("snapshot " + std::to_string(held) +
                             " can no longer be read: its samples were overwritten (the store is "
                             "at commit " +
                             std::to_string(newest) +
                             "); take a new snapshot, or raise snapshot_memory",
                         std::move(detail));
}

}  // namespace store

namespace {

template <class Attempt>
bool answered(const Reads::Impl& impl, CommitNumber held, CommitNumber fresh, Failure& failure,
              Attempt attempt) {
    const Outcome outcome = store::read(impl, held, fresh, attempt);
    if (outcome == Outcome::kOk)
        return true;
    if (outcome == Outcome::kLapped) {
        failure = Failure{};
        failure.code = ErrorCode::kSnapshotTooOld;
        failure.commit = held;
    }
    return false;
}

/// The same for handles. What was read counts only if none of their slots was reused by then.
template <class Attempt>
bool answered_of(const Reads::Impl& impl, CommitNumber held, CommitNumber fresh, Failure& failure,
                 std::initializer_list<FrameHandle> handles, Attempt attempt) {
    return answered(impl, held, fresh, failure, [&](const StoreView& view) {
        const Outcome outcome = attempt(view);
        sync::fence_acquire();
        int argument = 0;
        for (const FrameHandle handle : handles) {
            if (handle.id != kNoFrame && view.generation(handle.id) != handle.generation) {
                failure = Failure{};
                failure.argument = argument;
                failure.frame = handle.id;
                failure.commit = view.commit();
                return Outcome::kFailed;
            }
            ++argument;
        }
        return outcome;
    });
}

using store::ReadRequest;
using Kind = ReadRequest::Kind;

/// The engine that answers instead, if it is another one than the default.
store::Control* guarding(const Reads::Impl& impl, CommitNumber held, CommitNumber fresh) {
    return held == fresh ? impl.control.get() : nullptr;
}

bool guarded(const Reads::Impl& impl, const ReadRequest& request, Answer& answer, StampNs& common,
             Failure& failure) {
    store::check_not_in_transaction(impl);
    return impl.control->read(request, answer, common, failure) == Outcome::kOk;
}

}  // namespace

CommitNumber Reads::commit() const {
    return held_ == kFresh ? impl_->committed() : held_;
}

bool Reads::is_current(FrameHandle handle) const noexcept {
    return handle.id < impl_->frames.count() &&
           impl_->frames.generation(handle.id) == handle.generation;
}

bool Reads::find_frame(std::string_view name, FrameHandle& out) const {
    // Only commits that are alone make and remove frames: this one needs no engine.
    const auto attempt = [&](const StoreView& view) {
        out.id = impl_->names.find(name, view.commit());
        if (out.id == kNoFrame)
            return Outcome::kFailed;
        out.generation = view.generation(out.id);
        // The slot may have been reused between the two.
        return view.alive(out.id) ? Outcome::kOk : Outcome::kLapped;
    };
    return store::read_committed(*impl_, held_, kFresh, attempt) == Outcome::kOk;
}

bool Reads::try_lookup(FrameHandle target, FrameHandle source, std::optional<StampNs> stamp,
                       Policy policy, Answer& answer, Failure& failure) const {
    if (guarding(*impl_, held_, kFresh) != nullptr) [[unlikely]] {
        ReadRequest request(Kind::kLookup, {target, source});
        request.stamp = stamp;
        request.policy = policy;
        return guarded(*impl_, request, answer, answer.stamp, failure);
    }
    return answered_of(
        *impl_, held_, kFresh, failure, {target, source}, [&](const StoreView& view) {
            return lookup::lookup(view, target.id, source.id, stamp, policy, answer, failure);
        });
}

bool Reads::try_lookup_full(FrameHandle target, StampNs target_stamp, FrameHandle source,
                            StampNs source_stamp, FrameHandle fixed, Policy policy, Answer& answer,
                            Failure& failure) const {
    if (guarding(*impl_, held_, kFresh) != nullptr) [[unlikely]] {
        ReadRequest request(Kind::kFull, {target, source, fixed});
        request.stamp = target_stamp;
        request.source_stamp = source_stamp;
        request.policy = policy;
        return guarded(*impl_, request, answer, answer.stamp, failure);
    }
    return answered_of(
        *impl_, held_, kFresh, failure, {target, source, fixed}, [&](const StoreView& view) {
            return lookup::lookup_full(view, target.id, target_stamp, source.id, source_stamp,
                                       fixed.id, policy, answer, failure);
        });
}

bool Reads::try_lookup_latest(FrameHandle target, FrameHandle source,
                              std::optional<StampNs> max_age, StampNs now, Answer& answer,
                              Failure& failure) const {
    if (guarding(*impl_, held_, kFresh) != nullptr) [[unlikely]] {
        ReadRequest request(Kind::kLatest, {target, source});
        request.max_age = max_age;
        request.now = now;
        return guarded(*impl_, request, answer, answer.stamp, failure);
    }
    return answered_of(
        *impl_, held_, kFresh, failure, {target, source}, [&](const StoreView& view) {
            return lookup::lookup_latest(view, target.id, source.id, max_age, now, answer, failure);
        });
}

bool Reads::try_latest_common_time(FrameHandle target, FrameHandle source, StampNs& stamp,
                                   Failure& failure) const {
    Answer scratch;
    if (guarding(*impl_, held_, kFresh) != nullptr) [[unlikely]] {
        const ReadRequest request(Kind::kCommonTime, {target, source});
        return guarded(*impl_, request, scratch, stamp, failure);
    }
    return answered_of(
        *impl_, held_, kFresh, failure, {target, source}, [&](const StoreView& view) {
            return lookup::latest_common_time(view, target.id, source.id, scratch, stamp, failure);
        });
}

Answer Reads::lookup_transform(std::string_view target, std::string_view source,
                               std::optional<StampNs> stamp, Policy policy) const {
    Answer answer;
    Failure failure;
    if (guarding(*impl_, held_, kFresh) != nullptr) [[unlikely]] {
        ReadRequest request(Kind::kLookup, target, source);
        request.stamp = stamp;
        request.policy = policy;
        if (!guarded(*impl_, request, answer, answer.stamp, failure))
            raise(failure, target, source);
        return answer;
    }
    // Names and samples of one state: between two states a slot may get another frame.
    const bool found = answered(*impl_, held_, kFresh, failure, [&](const StoreView& view) {
        const FrameId to = impl_->names.find(target, view.commit());
        const FrameId from = impl_->names.find(source, view.commit());
        return lookup::lookup(view, to, from, stamp, policy, answer, failure);
    });
    if (!found)
        raise(failure, target, source);
    return answer;
}

Answer Reads::lookup_latest_transform(std::string_view target, std::string_view source,
                                      std::optional<StampNs> max_age, StampNs now) const {
    Answer answer;
    Failure failure;
    if (guarding(*impl_, held_, kFresh) != nullptr) [[unlikely]] {
        ReadRequest request(Kind::kLatest, target, source);
        request.max_age = max_age;
        request.now = now;
        if (!guarded(*impl_, request, answer, answer.stamp, failure))
            raise(failure, target, source);
        return answer;
    }
    const bool found = answered(*impl_, held_, kFresh, failure, [&](const StoreView& view) {
        const FrameId to = impl_->names.find(target, view.commit());
        const FrameId from = impl_->names.find(source, view.commit());
        return lookup::lookup_latest(view, to, from, max_age, now, answer, failure);
    });
    if (!found)
        raise(failure, target, source);
    return answer;
}

}  // namespace tfdb
