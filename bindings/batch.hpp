// What `lookup_transforms` of a store and of a transaction share.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

#include "arrays.hpp"
#include "reads.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// From here on a batch takes so long that other threads should run: about 0.1 ms and more.
inline constexpr std::size_t kReleaseFromRows = 8192;

/// The arguments of `lookup_transforms`, checked, and the rows to be written.
struct RowsWanted {
    /// Throws InvalidArgument, InvalidStamp, InvalidArray.
    RowsWanted(nb::handle target, nb::handle source, nb::handle stamps, nb::handle policy,
               nb::handle layout, nb::handle out, nb::handle missing);

    std::string_view target;
    std::string_view source;
    Layout layout;
    Missing missing;
    Policy policy;
    Stamps stamps;
    NewArray<double> result;
    std::optional<ArrayView> kept;  // while it is written, nobody may move what the caller gave

    /// Lets `reads`, a store's or a transaction's, write the rows. Needs no GIL.
    template <class From>
    void fill(From& reads) const {
        const std::span<const StampNs> when = stamps.values();
        const std::size_t width = layout == Layout::kPose ? 7 : 16;
        reads.lookup_many(target, source, when, policy, layout, missing,
                          {result.data, when.size() * width});
    }
};

}  // namespace tfdb::python
