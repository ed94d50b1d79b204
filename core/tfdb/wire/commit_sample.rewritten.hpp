// Encodes a decoded sample again. Each sample has exactly one encoding, so the bytes are equal.
#pragma once

#include <cstddef>
#include <vector>

#include "tfdb/wire/commit_sample.hpp"

namespace tfdb::wire::testing {

inline std::vector<std::byte> rewritten(const CommitSample& sample) {
    SampleWriter writer;
    writer.start();
    for (const std::string_view name : sample.names)
        (void)writer.add_name(name);
    for (const std::string_view authority : std::span(sample.authorities).subspan(1))
        (void)writer.add_authority(authority);
    const bool is_state = sample.kind == CommitSample::Kind::kState;
    CommitNumber before = sample.since;
    for (const CommitSample::Commit& commit : sample.commits) {
        const auto edges = sample.edges_of(commit);
        if (!is_state) {
            writer.start_commit(commit.number - before,
                                {sample.names_of(commit.cleared), sample.names_of(commit.removed),
                                 sample.names_of(commit.passing), sample.names_of(commit.made)},
                                edges.size());
            before = commit.number;
        }
        for (const CommitSample::Edge& edge : edges) {
            if (is_state)
                writer.add_frame(edge, sample.rows_of(edge));
            else
                writer.add_edge(edge, sample.rows_of(edge));
        }
    }
    return writer.finish(sample.kind, sample.epoch, sample.choice, sample.since, sample.last,
                         sample.edges.size());
}

}  // namespace tfdb::wire::testing
