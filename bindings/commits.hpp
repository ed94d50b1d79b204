// Applied commits: their options, and what a call returns.
#pragma once

#include <string_view>

#include "arguments.hpp"
#include "reads.hpp"
#include "writes.hpp"

namespace tfdb::python {

/// The options of `apply`.
/// Threads: with the GIL. Guarantee: its texts live as long as it and the objects do.
class AppliedOptions {
public:
    AppliedOptions(nb::handle source, nb::handle prefix, nb::handle shared) : unprefixed_(shared) {
        options_.source = name_of(source, "source");
        options_.prefix = name_of(prefix, "prefix");
        options_.shared = unprefixed_.views();
        for (const std::string_view text : {options_.source, options_.prefix}) {
            if (text.size() > kMaxNameBytes) {
                throw InvalidArgument("source and prefix have at most 1024 bytes, not " +
                                      std::to_string(text.size()));
            }
        }
    }
    [[nodiscard]] const ApplyOptions& get() const { return options_; }

private:
    FrameNames unprefixed_;
    ApplyOptions options_;
};

nb::object position_record(const Position& position);

/// Warns of each frame whose local parent was lost. Two sources of a shared frame may dispute it in
/// each commit: of such a frame it warns once.
void warn_of_lost(BufferObject& self, Applied applied, std::string_view source);

}  // namespace tfdb::python
