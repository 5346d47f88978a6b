#include "stages/labels/stage.hpp"

int main(int argc, char** argv) {
  return viscera::stage_main(argc, argv, viscera::labels_stage());
}
