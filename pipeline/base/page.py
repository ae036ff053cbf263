"""The look that all pages share."""

STYLE = "body{font:15px sans-serif;margin:2em}td,th{padding:.35em .8em;border-bottom:1px solid #ddd;text-align:right}" \
        "td:first-child,th:first-child,td:last-child,th:last-child{text-align:left}table{border-collapse:collapse}"
