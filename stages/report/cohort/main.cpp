#include "stages/report/cohort/cohort_stage.hpp"

int main(int argc, char** argv) {
  return viscera::stage_main(argc, argv, viscera::cohort_stage());
}
