#include "report.hpp"

#include <array>
#include <charconv>
#include <cmath>

namespace tfdb::driver {
namespace {

// Builds a flat JSON object. Threads: one. Guarantee: numbers that JSON lacks are written as null.
class Object {
public:
    void put(const std::string& key, const std::string& text) {
        name(key);
        text_ += '"' + text + '"';
    }
    void put(const std::string& key, const char* text) { put(key, std::string(text)); }
    void put(const std::string& key, bool value) {
        name(key);
        text_ += value ? "true" : "false";
    }
    template <class Number>
    void put(const std::string& key, Number value) {
        name(key);
        if constexpr (std::is_floating_point_v<Number>) {
            if (!std::isfinite(value)) {
                text_ += "null";
                return;
            }
        }
        std::array<char, 32> buffer{};
        const auto end = std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr;
        text_.append(buffer.data(), end);
    }
    [[nodiscard]] std::string text() const { return "{" + text_ + "}"; }

private:
    void name(const std::string& key) { text_ += (text_.empty() ? "\"" : ", \"") + key + "\": "; }
    std::string text_;
};

const char* name_of(Tree tree) {
    constexpr std::array<const char*, 4> kNames{"chain", "star", "humanoid", "random"};
    return kNames[static_cast<std::size_t>(tree)];
}

const char* name_of(WriteKind kind) {
    constexpr std::array<const char*, 3> kNames{"batch", "single", "modify"};
    return kNames[static_cast<std::size_t>(kind)];
}

void put_parameters(Object& json, const Options& o) {
    json.put("engine", o.engine);
    json.put("threads", o.threads);
    json.put("readers", o.readers());
    json.put("writers", o.writers());
    json.put("mixed", o.mixed());
    json.put("joints", o.joints);
    json.put("iterations", o.iterations);
    json.put("read_ratio", o.read_ratio);
    json.put("share", o.share == Share::kThreads ? "threads" : "operations");
    json.put("read_length", o.read_length);
    json.put("write_length", o.write_length);
    json.put("read_frequency", o.read_frequency);
    json.put("write_frequency", o.write_frequency);
    json.put("skew", o.skew);
    json.put("direction", o.opposite ? "opposite" : "same");
    json.put("lookup_from", o.from_low ? "low" : "high");
    json.put("tree", name_of(o.tree));
    json.put("time", o.time == Time::kLatest ? "latest" : "common");
    json.put("reads", o.reads == ReadKind::kLookup ? "lookup" : "transaction");
    json.put("writes", name_of(o.writes));
    json.put("pinned", o.pin);
    json.put("seed", o.seed);
    json.put("history", o.history_seconds());
}

void put_shares(Object& json, const std::string& prefix, const Histogram& histogram) {
    json.put(prefix + "_p50_ns", histogram.percentile(0.5));
    json.put(prefix + "_p90_ns", histogram.percentile(0.9));
    json.put(prefix + "_p99_ns", histogram.percentile(0.99));
    json.put(prefix + "_p999_ns", histogram.percentile(0.999));
    json.put(prefix + "_max_ns", histogram.longest());
}

void put_lane(Object& json, const std::string& prefix, const Lane& lane, double elapsed) {
    json.put(prefix + "_done", lane.done);
    json.put(prefix + "_per_s", static_cast<double>(lane.done) / elapsed);
    json.put(prefix + "_edges_per_s", static_cast<double>(lane.edges) / elapsed);
    json.put(prefix + "_failed", lane.failed);
    json.put(prefix + "_lost", lane.lost);
    json.put(prefix + "_deadlines", lane.due);
    json.put(prefix + "_deadlines_met",
             lane.due == 0 ? std::nan("")
                           : static_cast<double>(lane.met) / static_cast<double>(lane.due));
    put_shares(json, prefix, lane.latency);
}

}  // namespace

std::string to_json(const Options& options, const Outcome& outcome) {
    Object json;
    put_parameters(json, options);
    json.put("elapsed_s", outcome.elapsed);
    json.put("edges_per_read", outcome.edges_per_read);
    put_lane(json, "reads", outcome.tally.reads, outcome.elapsed);
    put_lane(json, "writes", outcome.tally.writes, outcome.elapsed);
    put_shares(json, "age", outcome.tally.age);
    put_shares(json, "spread", outcome.tally.spread);
    json.put("commits", outcome.counters.commits);
    json.put("aborts", outcome.counters.aborts);
    json.put("conflicts", outcome.counters.conflicts);
    json.put("retries", outcome.counters.retries);
    json.put("lock_waits", outcome.counters.lock_waits);
    json.put("lapped_reads", outcome.counters.lapped_reads);
    json.put("pinned_reads", outcome.counters.pinned_reads);
    json.put("worst_value", outcome.worst_value);
    return json.text();
}

}  // namespace tfdb::driver
