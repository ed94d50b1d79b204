#include "tfdb/geometry/batch_kernels.hpp"

#include <array>
#include <cstdlib>
#include <string_view>

namespace tfdb::geometry {

std::span<const Kernels* const> runnable_kernels() {
#if defined(__x86_64__)
    static constexpr std::array kAll = {&kV4Kernels, &kV3Kernels, &kPortableKernels};
    const bool v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
                    __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
    const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                    __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
                    __builtin_cpu_supports("avx512vl");
    return std::span(kAll).subspan(v4 ? 0 : v3 ? 1 : 2);
#else
    static constexpr std::array kAll = {&kPortableKernels};
    return kAll;
#endif
}

const Kernels& chosen_kernels() {
    static const Kernels& chosen = []() -> const Kernels& {
        const char* const wish = std::getenv("TFDB_KERNELS");
        const auto all = runnable_kernels();
        for (const Kernels* const kernels : all) {
            if (wish != nullptr && std::string_view(wish) == kernels->name)
                return *kernels;
        }
        return *all.front();
    }();
    return chosen;
}

}  // namespace tfdb::geometry
