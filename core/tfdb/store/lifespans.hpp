// How long the newest sample of an edge answers lookups.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "tfdb/store/buffer.hpp"

namespace tfdb::store {

/// Whether a name matches a pattern, in which `*` stands for any text.
[[nodiscard]] bool matches(std::string_view pattern, std::string_view name);

/// The lifespans that one process enforces in a store, by the names of an edge's frames.
/// Threads: any; it is immutable. Guarantee: wait-free except for memory.
class Lifespans {
public:
    explicit Lifespans(std::span<const Lifespan> all);

    /// The lifespan of an edge: the first match in order; null: none.
    [[nodiscard]] const Lifespan* of(std::string_view parent, std::string_view child) const;
    [[nodiscard]] bool same_as(std::span<const Lifespan> all) const;

private:
    std::vector<Lifespan> all_;
    std::unordered_map<std::string, std::vector<std::size_t>> by_child_;  // without `*`
    std::vector<std::size_t> patterns_;                                   // with `*` in the child
};

}  // namespace tfdb::store
