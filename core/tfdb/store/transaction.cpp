// The calls of a transaction. TransactionLife checks thread and stage; the engine answers.
#include "tfdb/store/transaction.hpp"

#include <unordered_map>

#include "tfdb/store/engine_transaction.hpp"
#include "tfdb/store/raise.hpp"
#include "tfdb/store/rows.hpp"
#include "tfdb/store/transaction_life.hpp"
#include "tfdb/store/validate.hpp"

namespace tfdb {

using store::TransactionLife;

Transaction::Transaction(Buffer& buffer, const TransactionOptions& options)
    : Transaction(buffer, options, BeginLater{}) {
    begin();
}

Transaction::Transaction(Buffer& buffer, const TransactionOptions& options, BeginLater)
    : life_(new TransactionLife(buffer.store_, options)) {}

Transaction::~Transaction() = default;

void Transaction::Release::operator()(TransactionLife* life) const noexcept {
    life->release();
}

void Transaction::begin() {
    life_->begin();
}

bool Transaction::ask(Question& question, Answer& answer, Failure& failure) const {
    return life_->call([&](auto& own) { return own.ask(question, answer, failure); });
}

std::optional<std::string> Transaction::parent_of(std::string_view name,
                                                  std::optional<StampNs> stamp) {
    return life_->call([&](auto& own) { return own.parent_of(name, stamp); });
}

bool Transaction::has_frame(std::string_view name) {
    return life_->call([&](auto& own) { return own.has_frame(name); });
}

Twist Transaction::lookup_velocity(std::string_view target, std::string_view source,
                                   std::optional<StampNs> stamp, StampNs interval,
                                   std::string_view reference, geometry::Vec3 point,
                                   std::string_view point_frame) {
    life_->check();
    const store::VelocityQuestion question =
        store::velocity_question(target, source, stamp, interval, reference, point, point_frame);
    Twist twist{};
    store::Asked asked;
    Failure failure;
    if (!life_->call([&](auto& own) { return own.velocity(question, twist, asked, failure); }))
        raise(failure, asked.about(question));
    return twist;
}

std::vector<StampNs> Transaction::path_stamps(std::string_view target, std::string_view source,
                                              std::optional<StampNs> start,
                                              std::optional<StampNs> end) {
    std::vector<StampNs> stamps;
    Failure failure;
    const bool found = life_->call(
        [&](auto& own) { return own.path_stamps(target, source, start, end, stamps, failure); });
    if (!found)
        raise(failure, store::by_name(Question::kCommonTime, target, source));
    return stamps;
}

std::vector<std::string> Transaction::frames() {
    return life_->call([](auto& own) { return own.all_frames(); });
}

FrameInfo Transaction::frame_info(std::string_view name) {
    return life_->call([&](auto& own) { return own.frame_info(name); });
}

std::vector<FrameInfo> Transaction::tree(std::optional<StampNs> stamp) {
    return life_->call([&](auto& own) { return own.tree(stamp); });
}

TreeColumns Transaction::tree_columns(std::optional<StampNs> stamp) {
    const std::vector<FrameInfo> infos = tree(stamp);
    TreeColumns columns;
    std::unordered_map<std::string_view, std::uint32_t> places;
    std::unordered_map<std::string_view, std::uint32_t> authorities;
    for (const FrameInfo& info : infos)
        places.emplace(info.name, static_cast<std::uint32_t>(places.size()));
    for (const FrameInfo& info : infos) {
        const auto next = static_cast<std::uint32_t>(authorities.size());
        const auto [authority, added] = authorities.emplace(info.authority, next);
        if (added)
            columns.authorities.push_back(info.authority);
        const auto parent = info.parent ? places.find(*info.parent) : places.end();
        columns.names.push_back(info.name);
        columns.rows.push_back({parent == places.end() ? TreeColumns::kNone : parent->second,
                                authority->second, info.is_static, info.cleared, info.samples,
                                info.oldest, info.newest, info.longest_gap, info.late});
    }
    return columns;
}

Samples Transaction::samples(std::string_view name) {
    return life_->call([&](auto& own) { return own.samples(name); });
}

void Transaction::raise(const Failure& failure, const Question& question) const {
    const auto name_of = [this](FrameHandle frame) {
        return frame.id == kNoFrame ? std::string()
                                    : life_->transaction().frame_name(frame.id, frame.generation);
    };
    std::string hint;
    if (failure.code == ErrorCode::kUnknownFrame)
        hint = life_->transaction().did_you_mean(store::unknown_of(failure, question).name,
                                                 failure.commit);
    store::raise_failure(failure, question, name_of, hint);
}

std::string Transaction::frame_name(FrameId id, std::uint32_t generation) const {
    return life_->transaction().frame_name(id, generation);
}

void Transaction::set_transforms(std::span<const TransformView> batch, bool is_static,
                                 std::string_view authority) {
    life_->call([&](auto& own) { own.write(batch, is_static, authority); });
}

void Transaction::remove_frames(std::span<const std::string_view> names, bool recursive) {
    life_->call([&](auto& own) { own.remove_frames(names, recursive); });
}

void Transaction::clear() {
    life_->call([](auto& own) { own.clear(); });
}

void Transaction::reparent(std::string_view child, std::string_view parent,
                           std::optional<StampNs> stamp, const std::optional<Pose>& pose,
                           std::string_view authority) {
    const Pose placed = pose ? *pose : lookup_transform(parent, child, stamp).pose;
    const TransformView transform{parent, child, stamp.value_or(0), placed};
    set_transforms({&transform, 1}, !stamp, authority);
}

CommitNumber Transaction::commit() {
    return life_->commit();
}

void Transaction::end_thread() noexcept {
    TransactionLife::end_thread();
}

void Transaction::abort() noexcept {
    life_->end(Stage::kAborted);
}

Transaction::Stage Transaction::stage() const noexcept {
    return life_->stage();
}

CommitNumber Transaction::committed() const noexcept {
    return life_->committed();
}

bool Transaction::has_written() const noexcept {
    return life_->has_written();
}

const std::optional<Conflict>& Transaction::lost_to() const noexcept {
    return life_->lost_to();
}

std::uint64_t Transaction::age() const noexcept {
    return life_->age();
}

void Transaction::check() const {
    life_->check();
}

void Transaction::check_thread() const {
    life_->check_thread();
}

void Transaction::lookup_many(std::string_view target, std::string_view source,
                              std::span<const StampNs> stamps, Policy policy, Layout layout,
                              Missing missing, std::span<double> out) {
    life_->check();
    store::check_room(stamps, layout, out);
    Answer answer;
    Failure failure;
    Question question = store::at_stamp(target, source, {}, policy);
    for (const int argument : {0, 1}) {
        if (!has_frame(argument == 0 ? target : source)) {
            failure.argument = argument;
            failure.commit = life_->call([](auto& own) { return own.read_as_of(); });
            raise(failure, question);
        }
    }
    for (std::size_t i = 0; i < stamps.size(); ++i) {
        if (i % 256 == 0)
            interruption_point();
        question.stamp = stamps[i];
        const bool found = ask(question, answer, failure);
        if (!found && missing == Missing::kThrow)
            store::raise_at(*this, failure, question, i);
        store::write_row(found ? &answer.pose : nullptr, layout,
                         out.data() + store::row_width(layout) * i);
    }
}

template <class Real>
void Transaction::lookup_edges(std::span<FrameRef> frames, std::optional<StampNs> stamp,
                               Policy policy, Missing missing, std::span<Real> out) const {
    life_->check();
    store::check_room(frames, out);
    Answer answer;
    Failure failure;
    Question question = store::of_edges(stamp, policy);
    for (std::size_t i = 0; i < frames.size(); ++i) {
        if (i % store::kEdgesBetweenEnds == 0)
            interruption_point();
        question.source = frames[i];
        const bool found = ask(question, answer, failure);
        if (!found && missing == Missing::kThrow)
            store::raise_at(*this, failure, question, i);
        store::write_row(found ? &answer.pose : nullptr, out.data() + 7 * i);
    }
}

template void Transaction::lookup_edges(std::span<FrameRef>, std::optional<StampNs>, Policy,
                                        Missing, std::span<float>) const;
template void Transaction::lookup_edges(std::span<FrameRef>, std::optional<StampNs>, Policy,
                                        Missing, std::span<double>) const;

template <class Real>
void Transaction::transform_points(std::string_view target, std::string_view source,
                                   const Real* points, std::size_t stride, std::size_t count,
                                   std::span<const StampNs> stamps, Policy policy, Missing missing,
                                   Real* out, std::size_t out_stride) {
    const bool one = stamps.size() == 1;
    store::check_points(points, stride, count, stamps, out, out_stride);
    std::vector<Pose> poses(stamps.size());
    lookup_many(target, source, stamps, policy, Layout::kPose, missing,
                {&poses.data()->translation.x, 7 * poses.size()});
    for (std::size_t i = 0; i < count; ++i) {
        const Real* const from = points + stride * i;
        const geometry::Vec3 moved = geometry::apply(
            poses[one ? 0 : i], {double{from[0]}, double{from[1]}, double{from[2]}});
        Real* const to = out + out_stride * i;
        to[0] = static_cast<Real>(moved.x);
        to[1] = static_cast<Real>(moved.y);
        to[2] = static_cast<Real>(moved.z);
    }
}

template void Transaction::transform_points(std::string_view, std::string_view, const float*,
                                            std::size_t, std::size_t, std::span<const StampNs>,
                                            Policy, Missing, float*, std::size_t);
template void Transaction::transform_points(std::string_view, std::string_view, const double*,
                                            std::size_t, std::size_t, std::span<const StampNs>,
                                            Policy, Missing, double*, std::size_t);

}  // namespace tfdb
