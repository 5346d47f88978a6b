#include "stages/report/compare/compare_stage.hpp"

int main(int argc, char** argv) {
  return viscera::stage_main(argc, argv, viscera::compare_stage());
}
