#include "stages/report/web_files.hpp"

#include "pipeline/base/embedded_file.hpp"

VISCERA_EMBEDDED_FILE(shell_html);
VISCERA_EMBEDDED_FILE(report_html);
VISCERA_EMBEDDED_FILE(report_css);
VISCERA_EMBEDDED_FILE(licences_html);
VISCERA_EMBEDDED_FILE(three_min_js);
VISCERA_EMBEDDED_FILE(OrbitControls_js);
VISCERA_EMBEDDED_FILE(chart_min_js);
VISCERA_EMBEDDED_FILE(format_js);
VISCERA_EMBEDDED_FILE(geometry_js);
VISCERA_EMBEDDED_FILE(marks_js);
VISCERA_EMBEDDED_FILE(view_js);
VISCERA_EMBEDDED_FILE(viewer_js);
VISCERA_EMBEDDED_FILE(charts_js);
VISCERA_EMBEDDED_FILE(slices_js);
VISCERA_EMBEDDED_FILE(tables_js);
VISCERA_EMBEDDED_FILE(gates_js);
VISCERA_EMBEDDED_FILE(lost_js);
VISCERA_EMBEDDED_FILE(inverted_js);
VISCERA_EMBEDDED_FILE(page_js);
VISCERA_EMBEDDED_FILE(main_js);
VISCERA_EMBEDDED_FILE(compare_html);
VISCERA_EMBEDDED_FILE(overlay_js);
VISCERA_EMBEDDED_FILE(study_charts_js);
VISCERA_EMBEDDED_FILE(compare_js);
VISCERA_EMBEDDED_FILE(cohort_html);
VISCERA_EMBEDDED_FILE(cohort_js);

namespace viscera::web {

std::string_view shell() {
  return VISCERA_EMBEDDED_TEXT(shell_html);
}

std::string_view licences() {
  return VISCERA_EMBEDDED_TEXT(licences_html);
}

std::string_view style() {
  return VISCERA_EMBEDDED_TEXT(report_css);
}

namespace {

// The libraries and what pages with a 3D view need, then what is a page's own.
std::vector<std::string_view> with_common(std::initializer_list<std::string_view> own) {
  std::vector<std::string_view> files{
      VISCERA_EMBEDDED_TEXT(three_min_js), VISCERA_EMBEDDED_TEXT(OrbitControls_js),
      VISCERA_EMBEDDED_TEXT(chart_min_js), VISCERA_EMBEDDED_TEXT(format_js),
      VISCERA_EMBEDDED_TEXT(geometry_js),  VISCERA_EMBEDDED_TEXT(view_js),
      VISCERA_EMBEDDED_TEXT(charts_js),    VISCERA_EMBEDDED_TEXT(page_js)};
  files.insert(files.end(), own);
  return files;
}

}  // namespace

Page report() {
  return {"report", "result", VISCERA_EMBEDDED_TEXT(report_html),
          with_common({VISCERA_EMBEDDED_TEXT(marks_js), VISCERA_EMBEDDED_TEXT(viewer_js),
                       VISCERA_EMBEDDED_TEXT(slices_js), VISCERA_EMBEDDED_TEXT(tables_js),
                       VISCERA_EMBEDDED_TEXT(gates_js), VISCERA_EMBEDDED_TEXT(lost_js),
                       VISCERA_EMBEDDED_TEXT(inverted_js), VISCERA_EMBEDDED_TEXT(main_js)})};
}

Page compare() {
  return {"compare", "answers", VISCERA_EMBEDDED_TEXT(compare_html),
          with_common({VISCERA_EMBEDDED_TEXT(overlay_js), VISCERA_EMBEDDED_TEXT(study_charts_js),
                       VISCERA_EMBEDDED_TEXT(compare_js)})};
}

Page cohort() {
  return {"cohort",
          "cases",
          VISCERA_EMBEDDED_TEXT(cohort_html),
          {VISCERA_EMBEDDED_TEXT(chart_min_js), VISCERA_EMBEDDED_TEXT(format_js),
           VISCERA_EMBEDDED_TEXT(charts_js), VISCERA_EMBEDDED_TEXT(page_js),
           VISCERA_EMBEDDED_TEXT(cohort_js)}};
}

}  // namespace viscera::web
