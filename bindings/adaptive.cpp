// The computation of `Trajectory.adaptive`.
#include "tfdb/geometry/adaptive.hpp"

#include <algorithm>
#include <span>
#include <vector>

#include "arrays.hpp"
#include "batch.hpp"
#include "numpy.hpp"
#include "reads.hpp"

namespace tfdb::python {
namespace {

/// For the arrays of a Trajectory without missing poses.
nb::object enough_rows(nb::handle stamps, nb::handle poses, double metres, double radians) {
    const Stamps when(stamps);
    nb::object keep;
    const ArrayView view = as_doubles(poses, "poses", keep);
    const std::size_t count = when.values().size();
    if (view.dimensions() != 2 || view.extent(0) != count || view.extent(1) != 7) {
        throw_bad_array("poses", "float64 (N, 7), a row for each stamp", describe(poses));
    }
    std::vector<std::size_t> rows;
    {
        const LongWork work(count >= kReleaseFromRows);
        rows = geometry::enough_rows(when.values(), {view.data<const geometry::Pose>(), count},
                                     metres, radians);
    }
    const NewArray<StampNs> result = new_stamps(rows.size());
    std::ranges::copy(rows, result.data);
    return result.array;
}

}  // namespace

void bind_adaptive(nb::module_& module) {
    module.def("_enough_rows", &enough_rows, nb::arg("stamps"), nb::arg("poses"), nb::arg("metres"),
               nb::arg("radians"),
               nb::sig("def _enough_rows(stamps: numpy.typing.NDArray[numpy.int64], poses: "
                       "numpy.typing.NDArray[numpy.float64], metres: float, radians: float) -> "
                       "numpy.typing.NDArray[numpy.int64]"));
}

}  // namespace tfdb::python
