// Helpers of the transaction tests.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <thread>

#include "tfdb/store/fixture.hpp"
#include "tfdb/store/transaction.hpp"

namespace tfdb::fixture {

inline void put(Transaction& tx, std::string_view parent, std::string_view child, StampNs stamp,
                double number) {
    const TransformView transform{parent, child, stamp, pose_of(number)};
    tx.set_transforms({&transform, 1}, false, "tx");
}
inline void put_static(Transaction& tx, std::string_view parent, std::string_view child,
                       double number) {
    const TransformView transform{parent, child, 0, pose_of(number)};
    tx.set_transforms({&transform, 1}, true, "tx");
}
inline double latest(Transaction& tx, std::string_view target, std::string_view source) {
    return number_of(tx.lookup_latest_transform(target, source).pose);
}
inline double latest(const StoreReader& reads, std::string_view target, std::string_view source) {
    return number_of(reads.lookup_latest_transform(target, source).pose);
}
inline bool has_frame(const StoreReader& reads, std::string_view name) {
    FrameHandle unused;
    return reads.find_frame(name, unused);
}

/// A thread with an open transaction must not write outside it.
inline void elsewhere(const std::function<void()>& body) {
    std::thread([&] {
        try {
            body();
        } catch (const std::exception& error) {
            testing::report_failure(__FILE__, __LINE__, error.what());
        }
    }).join();
}

/// Begins a transaction that reads, runs another write, and commits with a write of its own. Empty
/// without a conflict.
inline std::optional<Conflict> race(Buffer& buffer, const std::function<void(Transaction&)>& read,
                                    const std::function<void()>& write) {
    Transaction tx(buffer);
    read(tx);
    const CommitNumber before = buffer.commit();
    elsewhere(write);
    CHECK(buffer.commit() > before);
    const std::string mark = "mark" + std::to_string(buffer.commit());
    put_static(tx, "witness", mark, 1);
    try {
        tx.commit();
    } catch (const Conflict& conflict) {
        CHECK(!tx.is_open());
        CHECK(!has_frame(buffer, mark));
        return conflict;
    }
    CHECK(has_frame(buffer, mark));
    return std::nullopt;
}

}  // namespace tfdb::fixture
