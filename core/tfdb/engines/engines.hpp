// One maker per engine, each in a file of its own, so that they compile side by side.
#pragma once

#include <memory>

#include "tfdb/store/engine.hpp"

namespace tfdb::store {

[[nodiscard]] std::unique_ptr<Engine> make_giant(Reads::Impl& impl);
[[nodiscard]] std::unique_ptr<Engine> make_fine(Reads::Impl& impl);
[[nodiscard]] std::unique_ptr<Engine> make_no_wait(Reads::Impl& impl);
[[nodiscard]] std::unique_ptr<Engine> make_wait_die(Reads::Impl& impl);
[[nodiscard]] std::unique_ptr<Engine> make_wound_wait(Reads::Impl& impl);
[[nodiscard]] std::unique_ptr<Engine> make_silo(Reads::Impl& impl);

}  // namespace tfdb::store
