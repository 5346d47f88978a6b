#include "stages/surface/stage.hpp"

int main(int argc, char** argv) {
  return viscera::stage_main(argc, argv, viscera::surface_stage());
}
