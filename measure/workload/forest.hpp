// Trees of frames, the paths that are looked up in them and the runs that are written.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "options.hpp"

namespace tfdb::driver {

/// Two frames and the number of edges between them.
struct Path {
    std::uint32_t low = 0;
    std::uint32_t high = 0;
    std::uint32_t edges = 0;
};

// Frame 0 is the root; frame i > 0 names the edge to its parent, which comes before it.
// Threads: any, once made. Guarantee: `path` allocates nothing.
class Forest {
public:
    /// Throws BadOption where the shape does not fit into the number of joints.
    explicit Forest(const Options& options);

    [[nodiscard]] std::uint32_t edges() const { return edges_; }
    [[nodiscard]] std::uint32_t parent(std::uint32_t frame) const { return parents_[frame]; }
    [[nodiscard]] const std::string& name(std::uint32_t frame) const { return names_[frame]; }
    [[nodiscard]] std::uint32_t paths() const { return paths_; }
    [[nodiscard]] Path path(std::uint32_t which) const {
        return shape_ == Tree::kChain ? Path{which, which + length_, length_} : table_[which];
    }
    /// Runs of consecutive frames, `write_length` each; run r starts with frame r + 1.
    [[nodiscard]] std::uint32_t runs() const { return runs_; }
    /// The frames whose edges lie between the ends: low's side upward, then high's.
    void edges_between(const Path& path, std::vector<std::uint32_t>& from_low,
                       std::vector<std::uint32_t>& from_high) const;

private:
    void grow_chain();
    void grow_star(std::uint32_t read_length);
    void grow_humanoids();
    void grow_random(std::uint64_t seed, std::uint32_t read_length);
    void add_path(std::uint32_t low, std::uint32_t high);

    Tree shape_;
    std::uint32_t edges_;
    std::uint32_t length_;
    std::uint32_t paths_ = 0;
    std::uint32_t runs_ = 0;
    std::vector<std::uint32_t> parents_;
    std::vector<std::string> names_;
    std::vector<Path> table_;
};

}  // namespace tfdb::driver
