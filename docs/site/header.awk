# A header as doxygen reads it: its plain comments are documentation, those that are indented
# (equations, declarations) are shown as they are.
function leave() { if (inside) print "/// ~~~"; inside = 0 }
FNR == 1 && /^\/\/ / { print "/// \\file" }
/^ *\/\/   / {
  if (!inside) print "/// ~~~"
  inside = 1
  sub(/\/\/ /, "/// ")
  print
  next
}
/^ *\/\/ *$/ && inside { print "///"; next }
/^ *\/\/( |$)/ {
  leave()
  sub(/\/\//, "///")
  gsub(/</, "\\&lt;")
  print
  next
}
{
  leave()
  if (match($0, /[;,] +\/\/ /)) {
    note = substr($0, RSTART + RLENGTH)
    gsub(/</, "\\&lt;", note)
    $0 = substr($0, 1, RSTART) "  ///< " note
  }
  print
}
