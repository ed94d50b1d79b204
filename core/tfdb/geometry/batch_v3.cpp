// Compiled for x86-64-v3 (AVX2); runs only if the processor supports it: see batch_kernels.cpp.
#include "tfdb/geometry/batch_output.ipp"

namespace tfdb::geometry {

constinit const Kernels kV3Kernels = make_kernels<4>("v3");

}  // namespace tfdb::geometry
