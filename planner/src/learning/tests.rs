mod corridor;
