#include "tfdb/store/velocity.hpp"

#include <string>

#include "tfdb/store/freshness.hpp"
#include "tfdb/store/store.hpp"

namespace tfdb {

store::VelocityQuestion store::velocity_question(std::string_view target, std::string_view source,
                                                 std::optional<StampNs> stamp, StampNs interval,
                                                 std::string_view reference, const Vec3& point,
                                                 std::string_view point_frame) {
    if (interval <= 0 || interval > history::kForever) {
        throw InvalidArgument("the averaging interval must be positive and below 2^61 ns, got " +
                              std::to_string(interval) + " ns");
    }
    if (!geometry::is_finite({point, geometry::identity().rotation})) {
        throw InvalidArgument("the reference point of the velocity must be finite, got (" +
                              std::to_string(point.x) + ", " + std::to_string(point.y) + ", " +
                              std::to_string(point.z) + ")");
    }
    if (reference.empty())
        reference = target;
    if (point_frame.empty())
        point_frame = source;
    return {{target, source, reference, point_frame}, stamp, interval, point};
}

Twist StoreReader::lookup_velocity(std::string_view target, std::string_view source,
                                   std::optional<StampNs> stamp, StampNs interval,
                                   std::string_view reference, geometry::Vec3 point,
                                   std::string_view point_frame) const {
    const store::VelocityQuestion question =
        store::velocity_question(target, source, stamp, interval, reference, point, point_frame);
    Twist twist{};
    store::Asked asked;
    Failure failure;
    const bool found = store::read(*store_, held_, [&](const StoreView& view) {
        const auto find = [&](std::string_view name) {
            return store_->names.find(name, view.commit());
        };
        const auto name_of = [&](FrameId id) { return store_->names.name(id); };
        const auto judge = [&](FrameId to, FrameId from) {
            return store::path_unless_stale(*store_, view, name_of, to, from, failure);
        };
        return store::velocity_at(view, find, judge, question, twist, asked, failure);
    });
    if (!found)
        raise(failure, asked.about(question));
    return twist;
}

}  // namespace tfdb
