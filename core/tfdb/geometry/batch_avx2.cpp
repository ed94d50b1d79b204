// Compiled with -mavx2 and reached only where the processor has it: see batch.cpp.
#include "tfdb/geometry/batch_output.ipp"

namespace tfdb::geometry {

constinit const Kernels kAvx2Kernels = make_kernels<4>("avx2");

}  // namespace tfdb::geometry
