// How a Buffer with another concurrency than `snapshot` reads and writes.
#pragma once

#include <algorithm>
#include <array>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string_view>

#include "tfdb/lookup/view.hpp"
#include "tfdb/store/buffer.hpp"

namespace tfdb {
struct TransactionOptions;
}

namespace tfdb::store {

class Attempt;
class Batch;

/// One lookup, by handles or by names.
struct ReadRequest {
    enum class Kind : std::uint8_t { kLookup, kFull, kLatest, kCommonTime };

    /// Target, source and, for kFull, the fixed frame.
    ReadRequest(Kind which, std::initializer_list<FrameHandle> frames)
        : kind(which), count(frames.size()) {
        std::copy(frames.begin(), frames.end(), handles.begin());
    }
    ReadRequest(Kind which, std::string_view target, std::string_view source)
        : kind(which), by_name(true), names{target, source} {}

    Kind kind;
    bool by_name = false;
    std::size_t count = 2;
    std::array<FrameHandle, 3> handles{};
    std::array<std::string_view, 2> names{};
    std::optional<StampNs> stamp{};  // the target's, for kFull
    StampNs source_stamp = 0;
    Policy policy{};
    std::optional<StampNs> max_age{};
    StampNs now = 0;
};

/// The engine of one store. Null in its place: the default one, which needs none.
/// Threads: any; `keep_out` and `let_in` only the holder of the commit lock.
/// Guarantee: that of the engine's session (txn/); what is asked and written here starves nobody
/// and is starved by nobody: see txn::read_through.
class Control {
public:
    Control() = default;
    virtual ~Control() = default;
    Control(const Control&) = delete;
    Control& operator=(const Control&) = delete;

    /// kOk or kFailed; `common` is the answer to kCommonTime. Both answers and failures carry the
    /// number of the commit that they saw.
    [[nodiscard]] virtual lookup::Outcome read(const ReadRequest& request, Answer& answer,
                                               StampNs& common, Failure& failure) = 0;
    /// Throws as commit_batch.
    virtual CommitNumber write(const Batch& batch) = 0;
    /// False, and nothing was done, where it might have to wait.
    [[nodiscard]] virtual bool try_write(const Batch& batch, CommitNumber& commit) = 0;
    /// One transaction's attempt; `options` were checked, and `age` is set.
    [[nodiscard]] virtual std::unique_ptr<Attempt> attempt(const TransactionOptions& options) = 0;
    /// From `keep_out` to `let_in` nothing is under way that reads or writes.
    virtual void keep_out() = 0;
    virtual void let_in() = 0;
    virtual void add_to(Counters& counters) const = 0;
};

/// Null for the default engine.
[[nodiscard]] std::unique_ptr<Control> make_control(Reads::Impl& impl);

}  // namespace tfdb::store
