#include "options.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>
#include <map>
#include <sstream>
#include <utility>

namespace tfdb::driver {
namespace {

constexpr std::uint32_t kMostThreads = 1'024;
constexpr std::uint32_t kMostJoints = 1'000'000;

struct Option {
    std::string help;
    bool is_flag = false;
    std::function<void(Options&, const std::string& name, const std::string& text)> set;
};

[[noreturn]] void refuse(const std::string& name, const std::string& text,
                         const std::string& valid) {
    throw BadOption(name + " '" + text + "' is not valid: " + valid);
}

double number(const std::string& name, const std::string& text, double low, double high) {
    double value = 0.0;
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, value);
    if (error != std::errc{} || stop != end || !(value >= low && value <= high)) {
        std::ostringstream limits;
        limits << "a number from " << low << " to " << high;
        refuse(name, text, limits.str());
    }
    return value;
}

std::uint64_t whole(const std::string& name, const std::string& text, std::uint64_t low,
                    std::uint64_t high) {
    std::uint64_t value = 0;
    const char* const end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, value);
    if (error != std::errc{} || stop != end || value < low || value > high) {
        refuse(name, text,
               "a whole number from " + std::to_string(low) + " to " + std::to_string(high));
    }
    return value;
}

Option real(double Options::*member, double low, double high, std::string help) {
    return {std::move(help), false,
            [=](Options& options, const std::string& name, const std::string& text) {
                options.*member = number(name, text, low, high);
            }};
}

template <class Integer>
Option count(Integer Options::*member, std::uint64_t low, std::uint64_t high, std::string help) {
    return {std::move(help), false,
            [=](Options& options, const std::string& name, const std::string& text) {
                options.*member = static_cast<Integer>(whole(name, text, low, high));
            }};
}

template <class Value>
Option choice(Value Options::*member, std::vector<std::pair<std::string, Value>> choices,
              const std::string& help) {
    std::string valid;
    for (const auto& [word, value] : choices) {
        valid += (valid.empty() ? "" : ", ") + word;
    }
    return {help + ": " + valid, false,
            [=](Options& options, const std::string& name, const std::string& text) {
                for (const auto& [word, value] : choices) {
                    if (word == text) {
                        options.*member = value;
                        return;
                    }
                }
                refuse(name, text, "one of " + valid);
            }};
}

Option flag(bool Options::*member, bool value, std::string help) {
    return {std::move(help), true, [=](Options& options, const std::string&, const std::string&) {
                options.*member = value;
            }};
}

void set_frequency(Options& options, const std::string& name, const std::string& text) {
    options.read_frequency = options.write_frequency = number(name, text, 0.0, 1e6);
}

const std::map<std::string, Option>& table() {
    static const std::map<std::string, Option> options{
        {"--engine",
         {"the concurrency control", false,
          [](Options& o, const std::string&, const std::string& text) { o.engine = text; }}},
        {"--threads", count(&Options::threads, 1, kMostThreads, "threads")},
        {"--joints", count(&Options::joints, 2, kMostJoints, "moving frames")},
        {"--seconds", real(&Options::seconds, 0.001, 3600, "length of the measurement")},
        {"--iterations",
         count(&Options::iterations, 0, 1'000'000'000, "operations per thread instead of seconds")},
        {"--read-ratio", real(&Options::read_ratio, 0, 1, "share that reads")},
        {"--share",
         choice(&Options::share, {{"threads", Share::kThreads}, {"operations", Share::kOperations}},
                "what the read ratio is a share of")},
        {"--read-length", count(&Options::read_length, 1, kMostJoints, "edges per lookup")},
        {"--write-length", count(&Options::write_length, 1, kMostJoints, "edges per write")},
        {"--frequency",
         {"operations per second and thread, 0: without pause", false, set_frequency}},
        {"--read-frequency", real(&Options::read_frequency, 0, 1e6, "the same, of reads")},
        {"--write-frequency", real(&Options::write_frequency, 0, 1e6, "the same, of writes")},
        {"--deadline-ms", real(&Options::deadline_ms, 0, 1e6, "0: one period")},
        {"--skew", real(&Options::skew, 0, 5, "Zipf's theta, 0: uniform")},
        {"--direction", choice(&Options::opposite, {{"opposite", true}, {"same", false}},
                               "order of a batch against a lookup's")},
        {"--lookup-from",
         choice(&Options::from_low, {{"high", false}, {"low", true}}, "the source's end")},
        {"--tree", choice(&Options::tree,
                          {{"chain", Tree::kChain},
                           {"star", Tree::kStar},
                           {"humanoid", Tree::kHumanoid},
                           {"random", Tree::kRandom}},
                          "shape")},
        {"--time", choice(&Options::time, {{"latest", Time::kLatest}, {"common", Time::kCommon}},
                          "each edge's newest, or the latest common time")},
        {"--reads", choice(&Options::reads,
                           {{"lookup", ReadKind::kLookup}, {"transaction", ReadKind::kTransaction}},
                           "how to read")},
        {"--writes", choice(&Options::writes,
                            {{"batch", WriteKind::kBatch},
                             {"single", WriteKind::kSingle},
                             {"modify", WriteKind::kModify}},
                            "how to write")},
        {"--no-batch",
         {"the same as --writes single", true,
          [](Options& o, const std::string&, const std::string&) {
              o.writes = WriteKind::kSingle;
          }}},
        {"--no-pin", flag(&Options::pin, false, "leave threads to the scheduler")},
        {"--seed", count(&Options::seed, 0, ~std::uint64_t{0}, "of all random numbers")},
        {"--warmup", real(&Options::warmup, 0, 3600, "seconds before the measurement")},
        {"--history", real(&Options::history, 0, 3600, "seconds kept, 0: chosen")},
        {"--probes", count(&Options::probes, 1, 10'000, "paths whose values are checked")},
        {"--help", flag(&Options::help, true, "this text")},
    };
    return options;
}

void check_together(const Options& options) {
    const auto longest = std::max(options.read_length, options.write_length);
    if (longest > options.joints) {
        throw BadOption("a length of " + std::to_string(longest) + " needs --joints " +
                        std::to_string(longest) + " or more, not " +
                        std::to_string(options.joints));
    }
}

}  // namespace

std::uint32_t Options::readers() const {
    if (share == Share::kOperations && read_ratio > 0 && read_ratio < 1) {
        return 0;
    }
    return static_cast<std::uint32_t>(std::floor(threads * read_ratio + 1e-9));
}

std::uint32_t Options::mixed() const {
    if (share == Share::kOperations && read_ratio > 0 && read_ratio < 1) {
        return threads;
    }
    return threads * read_ratio - readers() > 1e-9 ? 1 : 0;
}

double Options::mixed_share() const {
    return mixed() == threads ? read_ratio : threads * read_ratio - readers();
}

double Options::history_seconds() const {
    if (history > 0) {
        return history;
    }
    // An answer at a common time needs a sample of every edge around it, whoever starves.
    const bool common = time == Time::kCommon || engine == "tf2";
    double chosen = std::clamp(5e-5 * joints, common ? 10.0 : 0.05, 30.0);
    const std::uint32_t writing = writers() + mixed();
    if (write_frequency > 0 && writing > 0) {
        const double per_second = write_frequency * write_length * writing;
        chosen = std::clamp(30.0 * joints / per_second, chosen, 60.0);
    }
    return chosen;
}

Options parse(const std::vector<std::string>& arguments) {
    Options options;
    for (std::size_t i = 0; i < arguments.size(); ++i) {
        const auto found = table().find(arguments[i]);
        if (found == table().end()) {
            throw BadOption("unknown option '" + arguments[i] + "'; --help lists all");
        }
        const Option& option = found->second;
        if (!option.is_flag && i + 1 == arguments.size()) {
            throw BadOption(arguments[i] + " needs a value: " + option.help);
        }
        const std::string text = option.is_flag ? "" : arguments[i + 1];
        option.set(options, arguments[i], text);
        i += option.is_flag ? 0 : 1;
    }
    if (!options.help) {
        check_together(options);
    }
    return options;
}

std::string usage() {
    std::string text = "One point of a measurement; prints one line of JSON.\n";
    for (const auto& [name, option] : table()) {
        text.append("  ").append(name).append(std::string(19 - name.size(), ' '));
        text.append(option.help).append("\n");
    }
    return text;
}

}  // namespace tfdb::driver
