#include "stages/simulate/stage.hpp"

int main(int argc, char** argv) {
  return viscera::stage_main(argc, argv, viscera::simulate_stage());
}
