// tfdb.types.Policy: the base of the policies, readable without a call into Python.
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>

#include <array>
#include <string>
#include <string_view>

#include "arguments.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "signatures.hpp"

namespace tfdb::python {
namespace {

using lookup::kNoLimit;
using lookup::PolicyKind;

PyTypeObject* g_type = nullptr;

// In the order of PolicyKind.
constexpr std::array<std::string_view, 5> kKinds = {"interpolate", "exact", "previous", "nearest",
                                                    "extrapolate"};

constexpr std::uint64_t kMostLimit = std::numeric_limits<StampNs>::max();
constexpr std::array<std::string_view, 2> kMakeNames = {"kind", "limit_ns"};

Policy make(const std::string& kind, std::optional<StampNs> limit) {
    for (std::size_t i = 0; i < kKinds.size(); ++i) {
        if (kKinds[i] == kind) {
            return {static_cast<PolicyKind>(i), limit ? std::min(*limit, kNoLimit) : kNoLimit};
        }
    }
    throw_error("InvalidArgument", "unknown kind of policy '" + kind + "'");
}

}  // namespace

Policy policy_of(PyObject* object) {
    if (!is_given(object)) {
        return {};
    }
    if (!PyObject_TypeCheck(object, g_type)) {
        PyErr_Format(PyExc_TypeError,
                     "policy must be an object such as tfdb.Interpolate() or tfdb.Previous(), "
                     "got %R",
                     object);
        throw nb::python_error();
    }
    return object_of<Policy>(object);
}

void bind_policy(nb::module_& module) {
    auto type = offered_class<nb::class_<Policy>>(
        module, "Policy", "How a stamp picks a pose from an edge's samples. Use a subclass.");
    type.def(
        "__init__",
        [](Policy* self, const nb::args& args, const nb::kwargs& keywords) {
            constexpr ParameterList kList{"Policy", kMakeNames, 1, 2};
            std::array<PyObject*, kMakeNames.size()> given{};
            bind_tuple(kList, args, keywords.ptr(), given.data());
            const std::string kind = option_of(given[0], "kind");
            std::optional<StampNs> limit;
            if (is_given(given[1])) {
                limit = static_cast<StampNs>(count_of(given[1], "limit_ns", 0, kMostLimit));
            }
            new (self) Policy(make(kind, limit));
        },
        nb::sig("def __init__(self, kind: str, limit_ns: int | None = None) -> None"));
    type.def_prop_ro(
        "kind",
        [](nb::handle self) {
            return kKinds[static_cast<std::size_t>(object_of<Policy>(self).kind)].data();
        },
        nb::sig("def kind(self) -> str"), "Name of the rule.");
    type.def_prop_ro(
        "limit_ns",
        [](nb::handle self) {
            const StampNs limit = object_of<Policy>(self).limit;
            return limit == kNoLimit ? std::nullopt : std::optional(limit);
        },
        nb::sig("def limit_ns(self) -> int | None"), "Its limit in nanoseconds; None: no limit.");
    g_type = reinterpret_cast<PyTypeObject*>(type.ptr());
}

}  // namespace tfdb::python
