#include "stages/report/report_stage.hpp"

int main(int argc, char** argv) {
  return viscera::stage_main(argc, argv, viscera::report_stage());
}
