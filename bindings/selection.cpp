#include "selection.hpp"

#include <nanobind/stl/string.h>

#include <optional>
#include <string>
#include <string_view>

#include "arguments.hpp"
#include "errors.hpp"
#include "reads.hpp"
#include "tfdb/store/buffer.hpp"

namespace tfdb::python {
namespace {

/// The text of a name. Bytes that are not UTF-8 become lone surrogates, which `bytes_of` converts
/// back; the store refuses such names.
nb::object text_of(std::string_view name) {
    nb::object text = nb::steal(
        PyUnicode_DecodeUTF8(name.data(), static_cast<Py_ssize_t>(name.size()), "surrogateescape"));
    if (!text.is_valid())
        throw nb::python_error();
    return text;
}

std::string bytes_of(nb::handle text, const char* role) {
    const nb::object bytes =
        nb::steal(PyUnicode_AsEncodedString(text.ptr(), "utf-8", "surrogateescape"));
    if (bytes.is_valid())
        return {PyBytes_AsString(bytes.ptr()), static_cast<std::size_t>(PyBytes_Size(bytes.ptr()))};
    forget_error();
    return std::string(name_of(text, role));
}

wire::Selection::Choose choice_by(nb::callable choose) {
    return [choose = std::move(choose)](std::uint32_t rule, std::string_view parent,
                                        std::string_view child) -> std::optional<wire::EdgeNames> {
        const nb::gil_scoped_acquire gil;
        const nb::object names = choose(rule, text_of(parent), text_of(child));
        if (names.is_none())
            return std::nullopt;
        const nb::object new_parent = names[0];
        const nb::object new_child = names[1];
        return wire::EdgeNames{bytes_of(new_parent, "parent"), bytes_of(new_child, "child")};
    };
}

wire::StampRange range_of(nb::handle first, nb::handle last) {
    wire::StampRange range;
    if (!first.is_none())
        range.first = nb::cast<clock::StampNs>(first);
    if (!last.is_none())
        range.last = nb::cast<clock::StampNs>(last);
    return range;
}

nb::object outside(const wire::Selection& self) {
    if (!self.outside())
        return nb::none();
    return nb::make_tuple(self.outside()->first, self.outside()->last);
}

nb::list kept(const wire::Selection& self) {
    nb::list edges;
    for (const wire::Selection::KeptEdge& edge : self.kept())
        edges.append(nb::make_tuple(edge.rule, text_of(edge.parent), text_of(edge.child)));
    return edges;
}

nb::object surveyed(const EdgeSurvey& self) {
    if (!self.is_tree())
        return nb::none();
    nb::dict edges;
    for (const auto& [child, edge] : self.edges()) {
        nb::object stamps = nb::none();
        if (!edge.is_static)
            stamps = nb::make_tuple(edge.first, edge.last);
        edges[text_of(child)] = nb::make_tuple(text_of(edge.parent), stamps);
    }
    return edges;
}

}  // namespace

SelectedSources::SelectedSources(nb::handle selection, const nb::dict& rules) {
    if (selection.is_none())
        return;
    selection_ = &nb::cast<wire::Selection&>(selection);
    for (const auto& [source, rule] : rules)
        rules_[nb::cast<std::uint32_t>(source)] = nb::cast<std::uint32_t>(rule);
}

Forgotten* forgotten_of(nb::handle object) {
    return object.is_none() ? nullptr : &nb::cast<Forgotten&>(object);
}

void bind_selection(nb::module_& module) {
    using wire::Selection;
    nb::class_<Selection>(module, "Selection",
                          "Which recorded transforms are kept, and the names of their frames.")
        .def(
            "__init__",
            [](Selection* self, nb::callable choose, nb::handle first, nb::handle last) {
                new (self) Selection(choice_by(std::move(choose)), range_of(first, last));
            },
            nb::arg("choose"), nb::arg("first").none() = nb::none(),
            nb::arg("last").none() = nb::none(),
            nb::sig("def __init__(self, choose: collections.abc.Callable[[int, str, str], "
                    "tuple[str, str] | None], first: int | None = None, last: int | None = None) "
                    "-> None"),
            "`choose` gets a source's rule, parent and child: once for each edge. It returns the "
            "new names; None leaves the edge out.\nMoving transforms are kept from stamp `first` "
            "to `last`, both included.")
        .def_prop_rw("shift", &Selection::shift, &Selection::set_shift,
                     "Nanoseconds that are added to the stamps of kept moving transforms.")
        .def_prop_ro("left_out", &Selection::left_out, "Number of transforms that were left out.")
        .def_prop_ro("moving", &Selection::moving, "Number of moving transforms that were kept.")
        .def_prop_ro("outside", &outside, nb::sig("def outside(self) -> tuple[int, int] | None"),
                     "First and last stamp that the time window left out of chosen edges.")
        .def("kept", &kept, nb::sig("def kept(self) -> list[tuple[int, str, str]]"),
             "Rule, parent and child, by their old names, of the edges that were kept.");
    nb::class_<Forgotten>(module, "Forgotten", "Counts samples that a limited history drops.")
        .def(
            "__init__",
            [](Forgotten* self, BufferObject& buffer) {
                new (self) Forgotten(buffer.open_store().history().value_or(clock::kMaxStamp));
            },
            nb::arg("buffer"), "By the history of `buffer`.")
        .def_prop_ro("count", &Forgotten::count, "Number of samples.");
    nb::class_<EdgeSurvey>(module, "EdgeSurvey", "The edges that recorded transforms would make.")
        .def(nb::init<>())
        .def("edges", &surveyed,
             nb::sig("def edges(self) -> dict[str, tuple[str, tuple[int, int] | None]] | None"),
             "Parent, and first and last stamp of a moving edge, by child.\n\n"
             "None: an edge has several parents, or edges form a cycle. Then a store must judge "
             "what it keeps.");
}

}  // namespace tfdb::python
