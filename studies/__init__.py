"""The study of the injection scene at full size: an example of how such a study is done with jaxdem; see README.md."""
