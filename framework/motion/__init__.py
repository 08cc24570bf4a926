"""When and where: paths x(s), laws s(t), functions of time. Knows no robot."""
