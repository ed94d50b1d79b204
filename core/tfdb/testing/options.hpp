// The options of a test program.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <initializer_list>
#include <string_view>

namespace tfdb::testing {

/// `--name 7` sets `value` to 7.
/// Threads: one. Guarantee: plain data.
struct Option {
    std::string_view name;
    unsigned& value;
};

/// Reads `--name value` pairs; exits if a name is unknown or a value is missing.
inline void read_options(int argc, char** argv, std::initializer_list<Option> options) {
    for (int i = 1; i < argc; i += 2) {
        const Option* found = nullptr;
        for (const Option& option : options)
            found = argv[i] == option.name ? &option : found;
        if (found == nullptr || i + 1 == argc) {
            std::fprintf(stderr, "%s is unknown, or has no number\n", argv[i]);
            std::exit(2);
        }
        found->value = static_cast<unsigned>(std::strtoul(argv[i + 1], nullptr, 10));
    }
}

}  // namespace tfdb::testing
