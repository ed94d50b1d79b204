// tfdb_driver_tf2: the same point of the same workload against Debian's tf2.
#include "run.hpp"
#include "tf2_store.hpp"

int main(int count, char** words) {
    return tfdb::driver::run_program<tfdb::driver::Tf2Store>("tfdb_driver_tf2", count, words,
                                                             "tf2");
}
