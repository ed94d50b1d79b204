// One thread: lookups, failed lookups and canTransform on chains of 1, 4, 10 and 100 moving edges.

#include <optional>
#include <string>
#include <vector>

#include "groups.hpp"
#include "scenario.hpp"

namespace bench {
namespace {

constexpr int kSamples = 2'000;
constexpr tfdb::StampNs kMidFrom = 12 * kPeriod;  // about ten samples back
constexpr tfdb::StampNs kMidTo = 8 * kPeriod;
constexpr tfdb::StampNs kFuture = 5'000'000'000;  // beyond the newest sample

/// All operations of this file, for one chain. Each cycles through 1,024 stamps.
class Operations {
public:
    explicit Operations(int chain)
        : chain_(chain, kSamples),
          stamps_(chain_.stamps(1'024, kMidFrom, kMidTo)),
          mid_(target(), source(), stamps_),
          future_(target(), source(), {chain_.newest + kFuture}) {
        chain_.verify(stamps_);
    }

    void tf2_mid(std::size_t count) const { chain_.theirs->lookups(mid_, count); }
    void tf2_latest(std::size_t count) const { chain_.theirs->latest_lookups(mid_, count); }
    void tf2_can(std::size_t count) const { chain_.theirs->can_transforms(mid_, count); }
    void tf2_failed(std::size_t count) const { chain_.theirs->failed_lookups(future_, count); }

    void ours_mid(std::size_t count) {
        for (std::size_t i = 0; i < count; ++i) {
            ask(stamps_[i & 1'023]);
        }
    }

    void ours_mid_by_name(std::size_t count) {
        for (std::size_t i = 0; i < count; ++i) {
            tfdb::FrameHandle t;
            tfdb::FrameHandle s;
            if (chain_.ours->find_frame(target(), t) && chain_.ours->find_frame(source(), s)) {
                keep(chain_.ours->ask(tfdb::store::at_stamp(t, s, stamps_[i & 1'023], {}), answer_,
                                      failure_));
            }
        }
    }

    void ours_latest(std::size_t count) {
        for (std::size_t i = 0; i < count; ++i) {
            ask(std::nullopt);
        }
    }

    void ours_newest(std::size_t count) {
        for (std::size_t i = 0; i < count; ++i) {
            keep(chain_.ours->ask(
                tfdb::store::of_newest(chain_.target, chain_.source, std::nullopt, 0), answer_,
                failure_));
        }
    }

    void ours_failed(std::size_t count) {
        for (std::size_t i = 0; i < count; ++i) {
            ask(chain_.newest + kFuture);
        }
    }

    void ours_failed_thrown(std::size_t count) {
        for (std::size_t i = 0; i < count; ++i) {
            try {
                keep(chain_.ours->lookup_transform(target(), source(), chain_.newest + kFuture));
            } catch (const tfdb::Extrapolation& error) {
                keep(error.what());
            }
        }
    }

private:
    [[nodiscard]] const std::string& target() const { return chain_.names.front(); }
    [[nodiscard]] const std::string& source() const { return chain_.names.back(); }

    void ask(std::optional<tfdb::StampNs> stamp) {
        keep(chain_.ours->ask(tfdb::store::at_stamp(chain_.target, chain_.source, stamp, {}),
                              answer_, failure_));
        keep(answer_.pose);
    }

    Chain chain_;
    std::vector<tfdb::StampNs> stamps_;
    real_tf2::Question mid_;
    real_tf2::Question future_;
    tfdb::Answer answer_;
    tfdb::Failure failure_;
};

}  // namespace

void lookup_rows(const Options& options) {
    for (const int chain : {1, 4, 10, 100}) {
        Operations run(chain);
        compare("lookup mid", chain, options,
                {{"tf2", [&](std::size_t n) { run.tf2_mid(n); }},
                 {"tfdb", [&](std::size_t n) { run.ours_mid(n); }},
                 {"tfdb by name", [&](std::size_t n) { run.ours_mid_by_name(n); }}});
        compare("lookup latest", chain, options,
                {{"tf2", [&](std::size_t n) { run.tf2_latest(n); }},
                 {"tfdb", [&](std::size_t n) { run.ours_latest(n); }},
                 {"tfdb newest of each edge", [&](std::size_t n) { run.ours_newest(n); }}});
        compare("canTransform", chain, options,
                {{"tf2", [&](std::size_t n) { run.tf2_can(n); }},
                 {"tfdb", [&](std::size_t n) { run.ours_mid(n); }}});
        compare("failed lookup", chain, options,
                {{"tf2", [&](std::size_t n) { run.tf2_failed(n); }},
                 {"tfdb", [&](std::size_t n) { run.ours_failed(n); }},
                 {"tfdb thrown", [&](std::size_t n) { run.ours_failed_thrown(n); }}});
    }
}

bool run_for_counting(const std::string& what, int chain, std::size_t count) {
    Operations run(chain);
    if (what == "tf2 lookup mid") {
        run.tf2_mid(count);
    } else if (what == "tfdb lookup mid") {
        run.ours_mid(count);
    } else if (what == "tf2 lookup latest") {
        run.tf2_latest(count);
    } else if (what == "tfdb lookup latest") {
        run.ours_latest(count);
    } else {
        return false;
    }
    return true;
}

}  // namespace bench
