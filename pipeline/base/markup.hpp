// Text as the content of an element or an attribute of HTML and XML.
#pragma once

#include <string>
#include <string_view>

namespace viscera {

std::string escaped_markup(std::string_view text);

}  // namespace viscera
