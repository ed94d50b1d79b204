#include "forest.hpp"

#include <algorithm>
#include <array>

#include "random.hpp"

namespace tfdb::driver {
namespace {

/// Parts of one robot, as links after each other: a part's first link hangs on `on`'s last.
struct Part {
    std::uint32_t links;
    int on;  // index of another part, -1: the world
};

constexpr std::array<Part, 8> kRobot{{
    {1, -1},  // 0 pelvis
    {3, 0},   // 1 torso
    {2, 1},   // 2 head
    {7, 1},   // 3 left arm
    {7, 1},   // 4 right arm
    {6, 0},   // 5 left leg
    {6, 0},   // 6 right leg
}};
constexpr std::uint32_t kRobotLinks = 32;
/// Hand to the other foot (16 edges), hand to hand (14), head to foot (11).
constexpr std::array<std::array<int, 2>, 5> kLookedUp{{{3, 6}, {4, 5}, {3, 4}, {2, 5}, {2, 6}}};

}  // namespace

Forest::Forest(const Options& options)
    : shape_(options.tree), edges_(options.joints), length_(options.read_length) {
    parents_.assign(edges_ + 1, 0);
    names_.reserve(edges_ + 1);
    for (std::uint32_t frame = 0; frame <= edges_; ++frame) {
        names_.push_back("f" + std::to_string(frame));
    }
    switch (shape_) {
        case Tree::kChain:
            grow_chain();
            break;
        case Tree::kStar:
            grow_star(options.read_length);
            break;
        case Tree::kHumanoid:
            grow_humanoids();
            break;
        case Tree::kRandom:
            grow_random(options.seed, options.read_length);
            break;
    }
    runs_ = edges_ - options.write_length + 1;
}

void Forest::grow_chain() {
    for (std::uint32_t frame = 1; frame <= edges_; ++frame) {
        parents_[frame] = frame - 1;
    }
    paths_ = edges_ - length_ + 1;
}

/// Arms around the root, so long that a lookup from tip to tip has `read_length` edges.
void Forest::grow_star(std::uint32_t read_length) {
    const std::uint32_t arm = std::max(1U, read_length / 2);
    const std::uint32_t arms = edges_ / arm;  // two or more: a lookup is not longer than the tree
    for (std::uint32_t frame = 1; frame <= edges_; ++frame) {
        const bool first = (frame - 1) % arm == 0 && (frame - 1) / arm < arms;
        parents_[frame] = first ? 0 : frame - 1;
    }
    for (std::uint32_t i = 0; i < arms; ++i) {
        const auto other = static_cast<std::uint32_t>((i * std::uint64_t{7'919} + 1) % arms);
        const std::uint32_t partner = other == i ? (i + 1) % arms : other;
        add_path((i + 1) * arm, (partner + 1) * arm);
    }
}

/// Robots of 32 links beside each other in one world.
void Forest::grow_humanoids() {
    if (edges_ < kRobotLinks) {
        throw BadOption("--tree humanoid needs --joints 32 or more, not " + std::to_string(edges_));
    }
    for (std::uint32_t base = 0; base + kRobotLinks <= edges_; base += kRobotLinks) {
        std::array<std::uint32_t, kRobot.size()> last{};
        std::uint32_t frame = base;
        for (std::size_t part = 0; part < kRobot.size(); ++part) {
            const int on = kRobot[part].on;
            std::uint32_t parent = on < 0 ? 0 : last[static_cast<std::size_t>(on)];
            for (std::uint32_t link = 0; link < kRobot[part].links; ++link) {
                parents_[++frame] = parent;
                parent = frame;
            }
            last[part] = parent;
        }
        for (const auto& [one, other] : kLookedUp) {
            add_path(last[static_cast<std::size_t>(one)], last[static_cast<std::size_t>(other)]);
        }
    }
}

/// Each frame hangs on one of the four before it; lookups span `read_length` frame numbers.
void Forest::grow_random(std::uint64_t seed, std::uint32_t read_length) {
    Random random(seed + 77);
    for (std::uint32_t frame = 1; frame <= edges_; ++frame) {
        parents_[frame] = frame - 1 - random.below(std::min(frame, 4U));
    }
    for (std::uint32_t low = 0; low + read_length <= edges_; ++low) {
        add_path(low, low + read_length);
    }
}

void Forest::add_path(std::uint32_t low, std::uint32_t high) {
    Path path{low, high, 0};
    std::uint32_t a = low;
    std::uint32_t b = high;
    // A parent comes before its children: the later of two frames cannot be above the other.
    for (; a != b; ++path.edges) {
        (a > b ? a : b) = parents_[a > b ? a : b];
    }
    table_.push_back(path);
    paths_ = static_cast<std::uint32_t>(table_.size());
}

void Forest::edges_between(const Path& path, std::vector<std::uint32_t>& from_low,
                           std::vector<std::uint32_t>& from_high) const {
    from_low.clear();
    from_high.clear();
    std::uint32_t a = path.low;
    std::uint32_t b = path.high;
    while (a != b) {
        std::uint32_t& later = a > b ? a : b;
        (a > b ? from_low : from_high).push_back(later);
        later = parents_[later];
    }
}

}  // namespace tfdb::driver
