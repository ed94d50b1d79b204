// Compiled for x86-64-v4 (AVX-512); runs only if the processor supports it: see batch_kernels.cpp.
#include "tfdb/geometry/batch_output.ipp"

namespace tfdb::geometry {

constinit const Kernels kV4Kernels = make_kernels<8>("v4");

}  // namespace tfdb::geometry
