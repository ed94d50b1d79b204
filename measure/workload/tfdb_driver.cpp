// tfdb_driver: one point of the workload against one of tfdb's engines.
#include "run.hpp"
#include "tfdb_store.hpp"

int main(int count, char** words) {
    return tfdb::driver::run_program<tfdb::driver::TfdbStore>("tfdb_driver", count, words, nullptr);
}
