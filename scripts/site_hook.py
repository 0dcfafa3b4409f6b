"""What mkdocs 1.4.2's readthedocs theme needs in Debian 12: there its jQuery lies under an older name, theme_extra.js is
missing (it gives tables their class), and so is the script for browsers before 2013. In other packages nothing changes."""

import os
import re


def on_post_page(output, page, config):
    def there(name):
        return any(os.path.exists(os.path.join(folder, "js", name)) for folder in config["theme"].dirs)

    if not there("jquery-3.6.0.min.js") and there("jquery-2.1.1.min.js"):
        output = output.replace("jquery-3.6.0.min.js", "jquery-2.1.1.min.js")
    if not there("theme_extra.js"):
        output = re.sub(r"<script[^>]*theme_extra\.js[^>]*></script>", "", output)
    return output.replace("<table>", '<table class="docutils">')
