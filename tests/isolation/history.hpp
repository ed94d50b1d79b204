// A recorded history: in memory while threads run, then written for tfdb_measure.verify.
#pragma once

#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>
#include <vector>

#include "tfdb/base/types.hpp"
#include "tfdb/clock/stamp.hpp"

namespace tfdb::recorder {

struct Seen {
    std::string edge;
    std::optional<clock::StampNs> stamp;  // none: its newest sample
    std::string before;                   // as JSON
    std::string after;
    std::size_t own = 0;
};

struct Written {
    std::string edge;
    std::string value;                    // as JSON
    std::optional<clock::StampNs> stamp;  // none: a static edge
    std::string parent;
    bool removed = false;
};

struct Operation {
    unsigned process = 0;
    unsigned thread = 0;
    std::int64_t begin = 0;
    std::int64_t end = 0;
    const char* status = "committed";
    std::optional<CommitNumber> commit;
    std::optional<CommitNumber> as_of;
    std::vector<Seen> reads;
    std::vector<Written> writes;
};

inline void print(std::FILE* out, const Seen& seen) {
    std::fprintf(out, "{\"edge\":\"%s\",", seen.edge.c_str());
    if (!seen.stamp) {
        std::fprintf(out, "\"value\":%s", seen.before.c_str());
    } else {
        std::fprintf(out, "\"kind\":\"at\",\"stamp\":%lld", static_cast<long long>(*seen.stamp));
        if (!seen.before.empty())
            std::fprintf(out, ",\"before\":%s", seen.before.c_str());
        if (!seen.after.empty())
            std::fprintf(out, ",\"after\":%s", seen.after.c_str());
    }
    std::fprintf(out, ",\"own\":%zu}", seen.own);
}

inline void print(std::FILE* out, const Written& written) {
    std::fprintf(out, "{\"edge\":\"%s\",\"value\":%s", written.edge.c_str(), written.value.c_str());
    if (written.removed) {
        std::fprintf(out, ",\"op\":\"remove\"}");
        return;
    }
    if (written.stamp)
        std::fprintf(out, ",\"stamp\":%lld", static_cast<long long>(*written.stamp));
    std::fprintf(out, ",\"parent\":\"%s\"}", written.parent.c_str());
}

inline void print(std::FILE* out, const Operation& operation, std::size_t number) {
    std::fprintf(out,
                 "{\"process\":%u,\"thread\":%u,\"id\":\"%u-%zu\",\"begin\":%lld,\"end\":%lld,"
                 "\"status\":\"%s\"",
                 operation.process, operation.thread, operation.process + operation.thread, number,
                 static_cast<long long>(operation.begin), static_cast<long long>(operation.end),
                 operation.status);
    if (operation.commit)
        std::fprintf(out, ",\"commit\":%llu", static_cast<unsigned long long>(*operation.commit));
    if (operation.as_of)
        std::fprintf(out, ",\"as_of\":%llu", static_cast<unsigned long long>(*operation.as_of));
    const auto list = [&](const char* name, const auto& items) {
        std::fprintf(out, ",\"%s\":[", name);
        for (std::size_t i = 0; i < items.size(); ++i) {
            if (i > 0)
                std::fputc(',', out);
            print(out, items[i]);
        }
        std::fputc(']', out);
    };
    list("reads", operation.reads);
    list("writes", operation.writes);
    std::fprintf(out, "}\n");
}

}  // namespace tfdb::recorder
