// One thread: set_transform in steady state (every write drops an old sample), and its allocations.

#include <array>
#include <span>
#include <vector>

#include "groups.hpp"
#include "scenario.hpp"

namespace bench {
namespace {

constexpr int kSamples = 12'000;  // 12 s at 1 kHz: the 10 s of history are full
constexpr std::size_t kPoses = 1'024;

/// Goes on writing where the chain's fill ended; each store counts on by itself.
class Writer {
public:
    explicit Writer(int chain) : chain_(chain, kSamples) {
        for (std::size_t i = 0; i < kPoses; ++i) {
            poses_[i] = moving_pose(static_cast<int>(i % 7), 1e-3 * static_cast<double>(i));
            plain_poses_.push_back(plain(poses_[i]));
        }
        for (int edge = 0; edge < chain; ++edge) {
            const auto at = static_cast<std::size_t>(edge);
            messages_.add(chain_.names[at], chain_.names[at + 1], 0, plain(poses_[0]));
            views_.push_back({chain_.names[at], chain_.names[at + 1], 0, poses_[0]});
        }
        theirs_ = ours_ = chain_.newest;
    }

    void tf2(std::size_t count) {
        chain_.theirs->writes(messages_, theirs_, kPeriod, their_turn_, plain_poses_, count);
    }

    void ours(std::size_t count) {
        for (std::size_t i = 0; i < count; ++i) {
            ours_ += our_turn_ == 0 ? kPeriod : 0;
            tfdb::TransformView& next = views_[our_turn_];
            our_turn_ = our_turn_ + 1 == views_.size() ? 0 : our_turn_ + 1;
            next.stamp = ours_;
            next.pose = poses_[i % kPoses];
            chain_.ours->set_transform(next, false, authority_);
        }
    }

    /// All edges in one commit; `count` counts transforms, as for the single writes.
    void ours_batch(std::size_t count) {
        for (std::size_t i = 0; i < count; i += views_.size()) {
            ours_ += kPeriod;
            for (tfdb::TransformView& view : views_) {
                view.stamp = ours_;
                view.pose = poses_[i % kPoses];
            }
            chain_.ours->set_transforms(views_, false, authority_);
        }
    }

private:
    Chain chain_;
    const std::string authority_ = "bench";
    std::array<tfdb::Pose, kPoses> poses_{};
    std::vector<real_tf2::Pose7> plain_poses_;
    real_tf2::Messages messages_;
    std::vector<tfdb::TransformView> views_;
    tfdb::StampNs theirs_ = 0;
    tfdb::StampNs ours_ = 0;
    std::size_t their_turn_ = 0;
    std::size_t our_turn_ = 0;
};

}  // namespace

void write_rows(const Options& options) {
    for (const int chain : {1, 4, 10}) {
        Writer writer(chain);
        compare("set_transform", chain, options,
                {{"tf2", [&](std::size_t n) { writer.tf2(n); }},
                 {"tfdb", [&](std::size_t n) { writer.ours(n); }},
                 {"tfdb batch", [&](std::size_t n) { writer.ours_batch(n); }}});
        constexpr std::size_t kWrites = 100'000;
        const std::size_t before = allocations();
        writer.tf2(kWrites);
        const std::size_t between = allocations();
        writer.ours(kWrites);
        const std::size_t after = allocations();
        constexpr double kEach = 1.0 / static_cast<double>(kWrites);
        print_row("allocations per set_transform", chain, "calls",
                  {{"tf2", {static_cast<double>(between - before) * kEach}},
                   {"tfdb", {static_cast<double>(after - between) * kEach}}});
    }
}

}  // namespace bench
