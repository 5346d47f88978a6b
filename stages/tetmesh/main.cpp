#include "stages/tetmesh/stage.hpp"

int main(int argc, char** argv) {
  return viscera::stage_main(argc, argv, viscera::tetmesh_stage());
}
