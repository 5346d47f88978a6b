#include "stages/report/web_files.hpp"

// Each embedded file lies between two symbols.
#define VISCERA_WEB_FILE(name)                \
  extern "C" const char viscera_web_##name[]; \
  extern "C" const char viscera_web_##name##_end[]

VISCERA_WEB_FILE(shell_html);
VISCERA_WEB_FILE(report_html);
VISCERA_WEB_FILE(report_css);
VISCERA_WEB_FILE(licences_html);
VISCERA_WEB_FILE(three_min_js);
VISCERA_WEB_FILE(OrbitControls_js);
VISCERA_WEB_FILE(chart_min_js);
VISCERA_WEB_FILE(format_js);
VISCERA_WEB_FILE(geometry_js);
VISCERA_WEB_FILE(marks_js);
VISCERA_WEB_FILE(view_js);
VISCERA_WEB_FILE(viewer_js);
VISCERA_WEB_FILE(charts_js);
VISCERA_WEB_FILE(slices_js);
VISCERA_WEB_FILE(tables_js);
VISCERA_WEB_FILE(gates_js);
VISCERA_WEB_FILE(lost_js);
VISCERA_WEB_FILE(inverted_js);
VISCERA_WEB_FILE(page_js);
VISCERA_WEB_FILE(main_js);
VISCERA_WEB_FILE(compare_html);
VISCERA_WEB_FILE(overlay_js);
VISCERA_WEB_FILE(study_charts_js);
VISCERA_WEB_FILE(compare_js);
VISCERA_WEB_FILE(cohort_html);
VISCERA_WEB_FILE(cohort_js);

#define VISCERA_WEB_VIEW(name) \
  std::string_view(viscera_web_##name, viscera_web_##name##_end - viscera_web_##name)

namespace viscera::web {

std::string_view shell() {
  return VISCERA_WEB_VIEW(shell_html);
}

std::string_view licences() {
  return VISCERA_WEB_VIEW(licences_html);
}

std::string_view style() {
  return VISCERA_WEB_VIEW(report_css);
}

namespace {

// The libraries and what pages with a 3D view need, then what is a page's own.
std::vector<std::string_view> with_common(std::initializer_list<std::string_view> own) {
  std::vector<std::string_view> files{
      VISCERA_WEB_VIEW(three_min_js), VISCERA_WEB_VIEW(OrbitControls_js),
      VISCERA_WEB_VIEW(chart_min_js), VISCERA_WEB_VIEW(format_js),
      VISCERA_WEB_VIEW(geometry_js),  VISCERA_WEB_VIEW(view_js),
      VISCERA_WEB_VIEW(charts_js),    VISCERA_WEB_VIEW(page_js)};
  files.insert(files.end(), own);
  return files;
}

}  // namespace

Page report() {
  return {"report", "result", VISCERA_WEB_VIEW(report_html),
          with_common({VISCERA_WEB_VIEW(marks_js), VISCERA_WEB_VIEW(viewer_js),
                       VISCERA_WEB_VIEW(slices_js), VISCERA_WEB_VIEW(tables_js),
                       VISCERA_WEB_VIEW(gates_js), VISCERA_WEB_VIEW(lost_js),
                       VISCERA_WEB_VIEW(inverted_js), VISCERA_WEB_VIEW(main_js)})};
}

Page compare() {
  return {"compare", "answers", VISCERA_WEB_VIEW(compare_html),
          with_common({VISCERA_WEB_VIEW(overlay_js), VISCERA_WEB_VIEW(study_charts_js),
                       VISCERA_WEB_VIEW(compare_js)})};
}

Page cohort() {
  return {"cohort",
          "cases",
          VISCERA_WEB_VIEW(cohort_html),
          {VISCERA_WEB_VIEW(chart_min_js), VISCERA_WEB_VIEW(format_js), VISCERA_WEB_VIEW(charts_js),
           VISCERA_WEB_VIEW(page_js), VISCERA_WEB_VIEW(cohort_js)}};
}

}  // namespace viscera::web
