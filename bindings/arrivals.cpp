// Recorded transforms in order of arrival, as arrays.
#include "arrivals.hpp"

#include <nanobind/stl/string.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "errors.hpp"
#include "numpy.hpp"
#include "reads.hpp"
#include "recorded.hpp"
#include "records.hpp"
#include "selection.hpp"
#include "tfdb/store/arrivals.hpp"
#include "writes.hpp"

namespace tfdb::python {
namespace {

using wire::TransformView;

/// Threads: the holder of the GIL.
class ArrivalLog {
public:
    explicit ArrivalLog(bool with_store) : arrivals(with_store) {}

    /// Adds the selected transforms of one message. It records whether the message writes a name
    /// with a leading slash, because decoding drops the slash.
    void add(const RecordedMessage& message, wire::Encoding encoding,
             const Arrivals::Message& about, SelectedSources& selected, bool note_slashes) {
        wire::decode_tf_message(message.bytes(), encoding, read_);
        chosen_.clear();
        origins_.clear();
        for (const TransformView& one : read_) {
            single_.assign(1, one);
            selected.apply(message.source, about.is_static, single_);
            if (!single_.empty()) {
                chosen_.push_back(single_.front());
                origins_.push_back(one);
            }
        }
        const bool noted = note_slashes && wire::is_little_endian(message.bytes(), encoding);
        arrivals.add(chosen_, about, [&](std::size_t i) {
            if (!noted)
                return;
            note(origins_[i].parent);
            note(origins_[i].child);
        });
    }

    /// Names that some messages write with a leading slash, and others without.
    [[nodiscard]] std::vector<std::string> mixed() const {
        std::vector<std::string> found;
        for (const auto& [name, spelled] : spelled_) {
            if (spelled == (kPlain | kSlash))
                found.push_back(name);
        }
        return found;
    }

    Arrivals arrivals;

private:
    static constexpr unsigned kPlain = 1;
    static constexpr unsigned kSlash = 2;

    void note(std::string_view name) {
        auto at = spelled_.find(name);
        if (at == spelled_.end())
            at = spelled_.try_emplace(std::string(name), 0).first;
        // The last byte of a short length is zero.
        at->second |= name.data()[-1] == '/' ? kSlash : kPlain;
    }

    std::map<std::string, unsigned, std::less<>> spelled_;
    std::vector<TransformView> read_;
    std::vector<TransformView> chosen_;
    std::vector<TransformView> origins_;
    std::vector<TransformView> single_;
};

std::map<std::uint32_t, std::string_view> names_by_source(const nb::dict& given) {
    std::map<std::uint32_t, std::string_view> names;
    for (const auto& [source, name] : given)
        names[nb::cast<std::uint32_t>(source)] = name_of(name, "publisher");
    return names;
}

void add(ArrivalLog& self, const Recorded& messages, std::size_t first, std::size_t last,
         nb::handle encoding, bool is_static, const nb::dict& publishers, bool note_slashes,
         nb::handle selection, const nb::dict& rules) {
    constexpr std::size_t kTogether = 1024;
    const wire::Encoding how = encoding_of(encoding);
    const auto names = names_by_source(publishers);
    SelectedSources selected(selection, rules);
    for (; first < last; first += kTogether) {
        look_for_signals(0);
        const std::vector<RecordedMessage> together =
            messages.between(first, std::min(last, first + kTogether));
        const LongWork work(true);
        for (const RecordedMessage& message : together) {
            const auto name = names.find(message.source);
            const Arrivals::Message about{static_cast<std::int64_t>(message.received),
                                          name == names.end() ? std::string_view() : name->second,
                                          is_static};
            try {
                self.add(message, how, about, selected, note_slashes);
            } catch (const CorruptMessage&) {
                continue;
            }
        }
    }
}

void hold(ArrivalLog& self, nb::handle transforms) {
    self.arrivals.hold(Transforms::from_batch(transforms, true).views);
}

template <class T, class From>
nb::object array_of(const std::vector<From>& values, const NewArray<T>& made) {
    static_assert(std::is_trivially_copyable_v<From>);
    std::memcpy(made.data, values.data(), values.size() * sizeof(From));
    return made.array;
}

/// The numeric columns of one child frame.
nb::tuple taken(const Arrivals::Columns& columns) {
    const std::size_t rows = columns.stamps.size();
    return nb::make_tuple(array_of(columns.stamps, new_stamps(rows)),
                          array_of(columns.received, new_stamps(rows)),
                          array_of(columns.poses, new_doubles({rows, 7})),
                          array_of(columns.parents, new_stamps(rows)),
                          array_of(columns.publishers, new_stamps(rows)));
}

nb::list take(ArrivalLog& self) {
    nb::list edges;
    auto& columns = self.arrivals.columns();
    while (!columns.empty()) {
        const auto first = columns.extract(columns.begin());
        const Arrivals::Columns& found = first.mapped();
        edges.append(nb::make_tuple(str_of_name(first.key()), taken(found),
                                    nb::bytes(found.is_static.data(), found.is_static.size())));
    }
    return edges;
}

nb::list names(const ArrivalLog& self) {
    nb::list result;
    for (const std::string& name : self.arrivals.names())
        result.append(str_of_name(name));
    return result;
}

nb::list mixed(const ArrivalLog& self) {
    nb::list result;
    for (const std::string& name : self.mixed())
        result.append(str_of_name(name));
    return result;
}

nb::dict conflicts(const ArrivalLog& self) {
    nb::dict result;
    for (const auto& [edge, count] : self.arrivals.conflicts())
        result[nb::make_tuple(str_of_name(edge.first), edge.second)] = count;
    return result;
}

}  // namespace

void bind_arrivals(nb::module_& module) {
    nb::class_<ArrivalLog>(module, "ArrivalLog",
                           "Recorded transforms in the order of their arrival, by child frame.")
        .def(nb::init<bool>(), nb::kw_only(), nb::arg("with_store"),
             "`with_store`: a store judges what is refused, needed where `is_right` is False.")
        .def("add", &add, nb::arg("messages"), nb::arg("first"), nb::arg("last"), nb::kw_only(),
             nb::arg("encoding").none(), nb::arg("static"), nb::arg("publishers"),
             nb::arg("note_slashes"), nb::arg("selection").none(), nb::arg("rules"),
             nb::sig("def add(self, messages: Recorded, first: int, last: int, *, encoding: str, "
                     "static: bool, publishers: dict[int, str], note_slashes: bool, "
                     "selection: Selection | None, rules: dict[int, int]) -> None"),
             "Add what a store keeps of the messages at [first, last). `publishers` and `rules` "
             "are by source.")
        .def("hold", &hold, nb::arg("transforms"),
             nb::sig("def hold(self, transforms: collections.abc.Sequence["
                     "tfdb.TransformStamped]) -> None"),
             "Store static transforms that did not arrive.")
        .def_prop_ro(
            "is_right", [](const ArrivalLog& self) { return self.arrivals.is_right(); },
            "False: parents changed, and a store must judge: read again `with_store`.")
        .def("take", &take,
             nb::sig(
                 "def take(self) -> list[tuple[str, tuple[numpy.typing.NDArray[numpy.int64], "
                 "numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], "
                 "numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.int64]], bytes]]"),
             "Child, and stamps, times of arrival, poses, parents, publishers, and whether static, "
             "sorted by child.\n\nParents and publishers are indices of `names`. The log is empty "
             "then.")
        .def("names", &names, nb::sig("def names(self) -> list[str]"),
             "Names of parents and publishers.")
        .def("mixed", &mixed, nb::sig("def mixed(self) -> list[str]"),
             "Frames that messages write both with a leading slash and without.")
        .def("conflicts", &conflicts, nb::sig("def conflicts(self) -> dict[tuple[str, bool], int]"),
             "Number of transforms refused with StaticConflict, by child and whether static.");
}

}  // namespace tfdb::python
