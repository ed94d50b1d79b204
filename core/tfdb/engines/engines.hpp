// One maker per engine, each in a file of its own, so that they compile side by side.
#pragma once

#include <memory>

#include "tfdb/store/control.hpp"

namespace tfdb::store {

[[nodiscard]] std::unique_ptr<Control> make_giant(Reads::Impl& impl);
[[nodiscard]] std::unique_ptr<Control> make_fine(Reads::Impl& impl);
[[nodiscard]] std::unique_ptr<Control> make_no_wait(Reads::Impl& impl);
[[nodiscard]] std::unique_ptr<Control> make_wait_die(Reads::Impl& impl);
[[nodiscard]] std::unique_ptr<Control> make_wound_wait(Reads::Impl& impl);
[[nodiscard]] std::unique_ptr<Control> make_silo(Reads::Impl& impl);

}  // namespace tfdb::store
