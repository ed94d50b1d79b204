// The selection of recorded messages' transforms, by a Python function.
#pragma once

#include <nanobind/nanobind.h>

#include <cstdint>
#include <map>

#include "tfdb/store/edge_survey.hpp"
#include "tfdb/store/forgotten.hpp"
#include "tfdb/wire/selection.hpp"

namespace nb = nanobind;

namespace tfdb::python {

/// A selection, or null, and the rule of each source.
/// Threads: the holder of the GIL; one uses it. The constructor's arguments outlive it.
class SelectedSources {
public:
    SelectedSources(nb::handle selection, const nb::dict& rules);

    /// Keeps only the selected members of a message.
    void apply(std::uint32_t source, bool is_static, std::vector<wire::TransformView>& members) {
        if (selection_ == nullptr)
            return;
        const auto rule = rules_.find(source);
        selection_->apply(rule == rules_.end() ? 0 : rule->second, is_static, members);
    }

private:
    wire::Selection* selection_ = nullptr;
    std::map<std::uint32_t, std::uint32_t> rules_;
};

/// The counter in a `Forgotten` object; null for None.
Forgotten* forgotten_of(nb::handle object);

/// Adds the classes Selection, Forgotten and EdgeSurvey to the module.
void bind_selection(nb::module_& module);

}  // namespace tfdb::python
