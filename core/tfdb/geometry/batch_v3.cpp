// Compiled for x86-64-v3 (AVX2) and reached only where the processor has it: see batch_kernels.cpp.
#include "tfdb/geometry/batch_output.ipp"

namespace tfdb::geometry {

constinit const Kernels kV3Kernels = make_kernels<4>("v3");

}  // namespace tfdb::geometry
