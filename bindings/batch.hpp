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
/// Up to so many are done before a signal could matter.
inline constexpr std::size_t kQuickRows = 128;

/// The arguments of `lookup_transforms`, checked, and the rows to be written.
struct RowsWanted {
    /// The last three may be null, which is for their default. Throws InvalidArgument,
    /// InvalidStamp, InvalidArray.
    RowsWanted(nb::handle target, nb::handle source, nb::handle stamps, nb::handle policy,
               nb::handle layout, nb::handle out, nb::handle missing);

    std::string_view target;
    std::string_view source;
    Layout layout;
    Missing missing;
    Policy policy;
    Stamps stamps;
    std::optional<ArrayView> kept;  // of `out`, while it is written: nobody may move its memory
    NewArray<double> result;

    [[nodiscard]] std::span<double> rows() const {
        return {result.data, stamps.values().size() * (layout == Layout::kPose ? 7 : 16)};
    }
};

}  // namespace tfdb::python
