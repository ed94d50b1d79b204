#include "tfdb/geometry/batch_output.ipp"

namespace tfdb::geometry {

constinit const Kernels kPortableKernels = make_kernels<2>("portable");

}  // namespace tfdb::geometry
