#include "instruction_sets.hpp"

#include <cstdlib>
#include <stdexcept>

namespace gs {
namespace {

constexpr const char* kVariable = "GS_SURROGATE_INSTRUCTION_SET";

}  // namespace

std::vector<const Kernels*> available() {
    std::vector<const Kernels*> found;
#if defined(GS_X86)
    const bool haswell = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi");
    if (haswell && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512vl"))
        found.push_back(&kernels_avx512);
    if (haswell) found.push_back(&kernels_avx2);
#endif
    found.push_back(&kernels_baseline);
    return found;
}

const Kernels& kernels_named(const std::string& asked) {
    const char* from_environment = asked.empty() ? std::getenv(kVariable) : nullptr;
    const std::string name = from_environment ? from_environment : asked;
    std::string names;
    for (const Kernels* kernels : available()) {
        if (name.empty() || name == kernels->name) return *kernels;
        names += (names.empty() ? "" : ", ") + std::string(kernels->name);
    }
    throw std::invalid_argument("instruction set '" + name + "'" + (from_environment ? std::string(" of ") + kVariable : "") +
                                " is none of this machine's: " + names);
}

}  // namespace gs
