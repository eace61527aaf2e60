"""Recording for the Rerun viewer."""

import os

# Rerun reads these when first imported. A recording is made because its user asks for it, whatever RERUN=off says;
# what Rerun's own log says of a file that cannot be written comes back as an error.
os.environ.pop("RERUN", None)
os.environ.setdefault("RUST_LOG", "warn,re_log_encoding=off,re_sdk=off")
